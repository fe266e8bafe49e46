"""Recordings as WAV: PCM of 16, 24 or 32 bits, or 32-bit floats, also with the extensible header; cut ones too."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.circuit_samples import Recording, SampleError, Stretch

PCM: Final = 1
EXTENSIBLE: Final = 0xFFFE
HEADER: Final = struct.Struct("<HHIIHH")


def _chunks(content: memoryview, path: Path) -> tuple[bytes, memoryview, bool]:
    """Format, samples, and whether the samples end before they should."""
    if bytes(content[:4]) != b"RIFF" or bytes(content[8:12]) != b"WAVE":
        msg = f"{path}: no WAV file: it does not begin with RIFF … WAVE"
        raise SampleError(msg)
    at, header = 12, b""
    while at + 8 <= len(content):
        name = bytes(content[at : at + 4])
        (size,) = struct.unpack_from("<I", content, at + 4)
        body = content[at + 8 : at + 8 + size]
        if name == b"fmt ":
            header = bytes(body)
        elif name == b"data":
            if len(header) < HEADER.size:
                break
            # Writers to a pipe leave the length at 0 or at its largest value.
            streamed = size in (0, 0xFFFF_FFFF)
            return header, content[at + 8 :] if streamed else body, len(body) < size and not streamed
        at += 8 + size + size % 2
    msg = f"{path}: no WAV file: its fmt and data chunks are missing or out of order"
    raise SampleError(msg)


def _numbers(body: memoryview, bits: int, kind: int, path: Path) -> tuple[NDArray[np.generic], float]:
    match kind, bits:
        case 1, 16:
            return np.frombuffer(body, "<i2"), 2.0**-15
        case 1, 24:
            octets = np.frombuffer(body, np.uint8).reshape(-1, 3)
            wide = np.zeros((len(octets), 4), np.uint8)
            wide[:, 1:] = octets
            return wide.view("<i4")[:, 0], 2.0**-31
        case 1, 32:
            return np.frombuffer(body, "<i4"), 2.0**-31
        case 3, 32:
            return np.frombuffer(body, "<f4"), 1.0
        case _:
            msg = f"{path}: {bits} bits in format {kind}: taken are PCM of 16, 24 and 32 bits and 32-bit floats"
            raise SampleError(msg)


def read_wav(path: Path, channel: int = 0) -> Recording:
    """A WAV recording; its samples are kept in memory. Raises SampleError and OSError."""
    header, body, cut = _chunks(memoryview(path.read_bytes()), path)
    kind, channels, rate_hz, _, _, bits = HEADER.unpack_from(header)
    if kind == EXTENSIBLE and len(header) >= 26:  # noqa: PLR2004 - up to the sub-format's first bytes
        (kind,) = struct.unpack_from("<H", header, 24)
    if not 0 <= channel < channels:
        msg = f"{path}: channel {channel}: the recording has {channels} (counted from 0)"
        raise SampleError(msg)
    if rate_hz == 0:
        msg = f"{path}: a rate of 0 samples/s"
        raise SampleError(msg)
    frame = max(channels * bits // 8, 1)
    warnings = [f"{path}: cut: it ends before the samples that it announces"] if cut or len(body) % frame else []
    numbers, scale = _numbers(body[: len(body) // frame * frame], bits, kind, path)
    samples = numbers.reshape(-1, channels)[:, channel]
    if not len(samples):
        msg = f"{path}: holds no samples"
        raise SampleError(msg)
    return Recording(
        name=str(path),
        sample_rate_hz=float(rate_hz),
        samples=samples,
        scale=scale,
        stretches=(Stretch(0, len(samples), 0, 0),),
        warnings=tuple(warnings),
    )
