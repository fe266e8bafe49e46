"""Samples of a sound device, through `arecord` (alsa-utils) as a child process."""

from __future__ import annotations

import os
import re
import select
import shutil
import subprocess
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.byte_source.source import READ_S, SourceError
from services.track_circuit.settings import AlsaInput

CHUNK: Final = 1 << 16
STOP_S: Final = 1.0
LONGEST_WORD: Final = 500
_OVERRUN: Final = re.compile(rb"overrun!!! \(at least ([0-9.]+) ms long\)")


class AlsaStream:
    """One channel of a device as 16-bit samples; missing ones are counted as `arecord` tells them."""

    def __init__(self, settings: AlsaInput, program: str = "arecord") -> None:
        """Know the device; `open` starts it."""
        self._settings, self._program = settings, program
        self._child: subprocess.Popen[bytes] | None = None
        self._rest = b""
        self._told = self._last_line = b""
        self.rate_hz = float(settings.rate_hz)
        self._lost_ms = 0.0

    @property
    def name(self) -> str:
        """Device."""
        return f"alsa {self._settings.device}"

    def open(self) -> None:
        """Start recording. Raises SourceError."""
        self.close()
        program = shutil.which(self._program)
        if program is None:
            msg = f"{self._program} is not installed (package alsa-utils)"
            raise SourceError(msg)
        settings = self._settings
        command = [program, "-q", "-D", settings.device, "-t", "raw", "-f", "S16_LE"]
        command += ["-r", str(settings.rate_hz), "-c", str(settings.channels)]
        try:
            self._child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0)  # noqa: S603 - no shell; the device's name is checked by its setting
        except OSError as error:
            msg = f"{program} does not start: {error}"
            raise SourceError(msg) from error
        for pipe in (self._child.stdout, self._child.stderr):
            if pipe is not None:
                os.set_blocking(pipe.fileno(), False)

    def read(self) -> tuple[NDArray[np.float64], int]:
        """Samples that have come within READ_S, full scale ±1, and how many are missing before them.

        Raises SourceError when the device is gone.
        """
        child = self._child
        if child is None or child.stdout is None or child.stderr is None:
            msg = "the device is not open"
            raise SourceError(msg)
        select.select([child.stdout], [], [], READ_S)
        chunk = child.stdout.read(CHUNK)
        *lines, rest = (self._told + (child.stderr.read(CHUNK) or b"")).split(b"\n")
        self._told = rest[-LONGEST_WORD:]
        self._last_line = lines[-1] if lines else self._last_line
        self._lost_ms += sum(float(found) for line in lines for found in _OVERRUN.findall(line))
        if chunk == b"":
            said = (self._told or self._last_line)[-LONGEST_WORD:].decode("utf-8", "replace").strip()
            reason = said or f"exit code {child.wait(STOP_S)}"
            msg = f"recording ended: {reason}"
            raise SourceError(msg)
        content = self._rest + (chunk or b"")
        frame = 2 * self._settings.channels
        whole = len(content) // frame * frame
        self._rest = content[whole:]
        frames = np.frombuffer(content[:whole], "<i2").reshape(-1, self._settings.channels)
        lost = round(self._lost_ms * self.rate_hz / 1000.0)
        self._lost_ms = 0.0
        return frames[:, self._settings.channel].astype(np.float64) * 2.0**-15, lost

    def close(self) -> None:
        """Stop recording; closing twice is no fault."""
        child, self._child = self._child, None
        if child is None:
            return
        child.terminate()
        try:
            child.wait(STOP_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        for pipe in (child.stdout, child.stderr):
            if pipe is not None:
                pipe.close()
        self._rest = self._told = self._last_line = b""
