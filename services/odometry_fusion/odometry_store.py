"""What odometry keeps on disk for its next start: whole or not at all, also after kill -9 and power cuts."""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from services.odometry_fusion.motion_log import Remembered

LARGEST_BYTES: Final = 4096
Bias = Annotated[float, Meta(ge=-0.2, le=0.2)]
Shaken = Annotated[float, Meta(ge=0.0, le=100.0)]


class StoreError(ValueError):
    """A state file that cannot be used: path and why."""


class _Kept(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    starts: Annotated[int, Meta(ge=0)]
    learned: bool = False
    roll_bias_radps: Bias = 0.0
    pitch_bias_radps: Bias = 0.0
    yaw_bias_radps: Bias = 0.0
    wheel_scale: Annotated[float, Meta(ge=0.5, le=2.0)] | None = None
    wheel_scale_sigma: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    rest_mps2: Shaken | None = None
    rest_radps: Shaken | None = None


def state_file(folder: Path, line: str, train: str) -> Path:
    """File of one train."""
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", f"{line}-{train}")
    return folder / "odometry_fusion" / f"{safe}-{zlib.crc32(f'{line}/{train}'.encode()):08x}.json"


def write_state(path: Path, starts: int, known: Remembered | None) -> None:
    """Put the state beside, then in place of the one before. Raises OSError."""
    kept = _Kept(starts=starts)
    if known is not None:
        kept = _Kept(
            starts=starts,
            learned=True,
            roll_bias_radps=known.roll_bias_radps,
            pitch_bias_radps=known.pitch_bias_radps,
            yaw_bias_radps=known.yaw_bias_radps,
            wheel_scale=known.wheel_scale,
            wheel_scale_sigma=known.wheel_scale_sigma,
            rest_mps2=known.rest_mps2,
            rest_radps=known.rest_radps,
        )
    body = msgspec.json.encode(kept)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".new")
    with beside.open("wb") as file:
        file.write(body + b"\n" + f"{zlib.crc32(body):08x}\n".encode())
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


def read_state(path: Path) -> tuple[int, Remembered | None]:
    """Starts so far, and what was learned; 0 and None where there is nothing. Raises StoreError, OSError."""
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_BYTES)
    except FileNotFoundError:
        return 0, None
    body, _, check = text.partition(b"\n")
    if check.strip() != f"{zlib.crc32(body):08x}".encode():
        msg = f"{path}: damaged: its checksum is not that of what it holds"
        raise StoreError(msg)
    try:
        kept = msgspec.json.decode(body, type=_Kept)
    except msgspec.DecodeError as error:
        msg = f"{path}: {error}"
        raise StoreError(msg) from error
    if not kept.learned:
        return kept.starts, None
    biases = (kept.roll_bias_radps, kept.pitch_bias_radps, kept.yaw_bias_radps)
    rest = (kept.rest_mps2, kept.rest_radps)
    return kept.starts, Remembered(*biases, kept.wheel_scale, kept.wheel_scale_sigma, *rest)
