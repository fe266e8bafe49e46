"""Recordings as SigMF (version 1): a JSON file beside raw samples.

Taken are real samples (`ri16_le`, `ri32_le`, `ri8`, `rf32_le`), one channel or several interleaved. Captures whose
`core:global_index` jumps are gaps. The optional extension `trackcircuit:` may bring circuit and profile.
"""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.track_circuit.circuit_samples import NS, Recording, SampleError, Stretch

TYPES: Final[dict[str, tuple[str, float]]] = {
    "ri16_le": ("<i2", 2.0**-15),
    "ri32_le": ("<i4", 2.0**-31),
    "ri8": ("i1", 2.0**-7),
    "rf32_le": ("<f4", 1.0),
}
LARGEST_META_BYTES: Final = 64 * 1024 * 1024
RATES_HZ: Final = (1_000.0, 10_000_000.0)
HASH_BLOCK: Final = 1 << 20


def _paths(path: Path) -> tuple[Path, Path]:
    """Metadata and samples of a recording, whichever of the two was named."""
    base = path.with_suffix("") if path.suffix in (".sigmf-meta", ".sigmf-data") else path
    return base.with_name(base.name + ".sigmf-meta"), base.with_name(base.name + ".sigmf-data")


def _metadata(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    if path.stat().st_size > LARGEST_META_BYTES:
        msg = f"{path}: more than {LARGEST_META_BYTES} bytes are no metadata"
        raise SampleError(msg)
    try:
        read = msgspec.json.decode(path.read_bytes())
    except msgspec.DecodeError as error:
        msg = f"{path}: {error}"
        raise SampleError(msg) from error
    whole, captures = (read.get("global"), read.get("captures", [])) if isinstance(read, dict) else (None, None)
    if not isinstance(whole, dict) or not isinstance(captures, list) or not all(isinstance(c, dict) for c in captures):
        msg = f"{path}: SigMF metadata has an object `global` and a list `captures`"
        raise SampleError(msg)
    return whole, captures


def _number(where: Path, table: dict[str, Any], name: str, default: float | None = None) -> float:
    value = table.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        msg = f"{where}: {name}: expected a number, got {value!r}"
        raise SampleError(msg)
    return float(value)


def _time_ns(path: Path, text: object) -> int:
    if text is None:
        return 0
    try:
        when = datetime.fromisoformat(str(text))
    except ValueError as error:
        msg = f"{path}: core:datetime: {text!r} is no ISO 8601 time"
        raise SampleError(msg) from error
    aware = when if when.tzinfo else when.replace(tzinfo=UTC)
    return round((aware - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() * 1e6) * 1000


def _stretches(meta: Path, captures: list[dict[str, Any]], count: int, offset: int, rate_hz: float) -> list[Stretch]:
    """Parts without gaps: a new one wherever a capture's converter index is not the next one."""
    starts: list[tuple[int, int, int | None]] = []
    for capture in captures or [{}]:
        if capture.get("core:header_bytes"):
            msg = f"{meta}: core:header_bytes: samples with headers between them are not read"
            raise SampleError(msg)
        begin = int(_number(meta, capture, "core:sample_start", 0)) - offset
        index = int(_number(meta, capture, "core:global_index", begin + offset))
        when = capture.get("core:datetime")
        starts.append((begin, index, None if when is None else _time_ns(meta, when)))
    if starts[0][0] > 0:
        starts.insert(0, (0, starts[0][1] - starts[0][0], None))
    if any(b[0] <= a[0] or b[1] < a[1] for a, b in pairwise(starts)) or starts[0][0] < 0:
        msg = f"{meta}: captures: core:sample_start must rise from capture to capture"
        raise SampleError(msg)
    found: list[Stretch] = []
    for number, (begin, index, when_ns) in enumerate(starts):
        end = min(starts[number + 1][0] if number + 1 < len(starts) else count, count)
        if end <= begin:
            break
        if found and index - found[-1].first_sample == begin - found[-1].begin:
            last = found.pop()
            found.append(Stretch(last.begin, end, last.first_sample, last.t_ns))
            continue
        follows_ns = 0
        if found:
            follows_ns = found[-1].t_ns + round((index - found[-1].first_sample) / rate_hz * NS)
        found.append(Stretch(begin, end, index, follows_ns if when_ns is None else when_ns))
    return found


def _samples(path: Path, datatype: str, channels: int, channel: int, warnings: list[str]) -> NDArray[np.generic]:
    code, _ = TYPES[datatype]
    frame = np.dtype(code).itemsize * channels
    size = path.stat().st_size
    if size % frame:
        warnings.append(f"{path}: cut within a sample: {size} bytes are no multiple of {frame}")
    if size < frame:
        msg = f"{path}: holds no samples"
        raise SampleError(msg)
    raw = np.memmap(path, dtype=code, mode="r", shape=(size // frame, channels))
    return raw[:, channel]


def _hash_of(path: Path) -> str:
    digest = hashlib.sha512()
    with path.open("rb") as file:
        while block := file.read(HASH_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def read_sigmf(path: Path, channel: int = 0) -> Recording:
    """A SigMF recording by its .sigmf-meta or .sigmf-data.

    A wrong checksum and a cut end become warnings: what is there is used. Raises SampleError and OSError.
    """
    meta, samples = _paths(path)
    whole, captures = _metadata(meta)
    datatype = whole.get("core:datatype")
    if datatype not in TYPES:
        msg = f"{meta}: core:datatype: {datatype!r}; taken are real samples: {', '.join(TYPES)}"
        raise SampleError(msg)
    rate_hz = _number(meta, whole, "core:sample_rate")
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        msg = f"{meta}: core:sample_rate: {rate_hz:g} is not between {RATES_HZ[0]:g} and {RATES_HZ[1]:g}"
        raise SampleError(msg)
    channels = int(_number(meta, whole, "core:num_channels", 1))
    if not 0 <= channel < channels:
        msg = f"{meta}: channel {channel}: the recording has {channels} (counted from 0)"
        raise SampleError(msg)
    warnings: list[str] = []
    read = _samples(samples, datatype, channels, channel, warnings)
    wanted = whole.get("core:sha512")
    if isinstance(wanted, str) and wanted.lower() != _hash_of(samples):
        warnings.append(f"{samples}: its SHA-512 is not the one in the metadata: changed, or cut")
    offset = int(_number(meta, whole, "core:offset", 0))
    profile = whole.get("trackcircuit:profile")
    scale = _number(meta, whole, "trackcircuit:scale", TYPES[datatype][1])
    return Recording(
        name=str(meta),
        sample_rate_hz=rate_hz,
        samples=read,
        scale=scale,
        stretches=tuple(_stretches(meta, captures, len(read), offset, rate_hz)),
        circuit=str(whole.get("trackcircuit:circuit_id", "")),
        profile=None if profile is None else msgspec.json.encode(profile),
        warnings=tuple(warnings),
    )
