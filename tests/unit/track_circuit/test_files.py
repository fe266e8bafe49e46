"""Recordings as files: what fits is read, what is cut or changed is told, and what cannot be meant is refused."""

from __future__ import annotations

import hashlib
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from services.byte_source.source import SourceError
from services.track_circuit.alsa_stream import AlsaStream
from services.track_circuit.circuit_samples import Recording, SampleError
from services.track_circuit.raw_stream import read_raw
from services.track_circuit.settings import AlsaInput
from services.track_circuit.sigmf_file import read_sigmf
from services.track_circuit.wav_file import read_wav

VALUES = np.array([0, 1, -1, 1000, -32768, 32767], np.int16)


def written(folder: Path, raw: bytes | None = None, captures: Any = None, **fields: Any) -> Path:  # noqa: ANN401 - JSON
    content = VALUES.astype("<i2").tobytes() if raw is None else raw
    (folder / "one.sigmf-data").write_bytes(content)
    whole = {"core:datatype": "ri16_le", "core:sample_rate": 48_000} | {
        k.replace("__", ":"): v for k, v in fields.items()
    }
    stood = [{"core:sample_start": 0}] if captures is None else captures
    path = folder / "one.sigmf-meta"
    path.write_text(json.dumps({"global": whole, "captures": stood, "annotations": []}))
    return path


def whole(recording: Recording) -> NDArray[np.float64]:
    return recording.taken(0, len(recording.samples))


def test_samples_come_at_full_scale_and_blocks_join(tmp_path: Path) -> None:
    for named in ("one.sigmf-meta", "one.sigmf-data"):
        written(tmp_path)
        recording = read_sigmf(tmp_path / named)
        np.testing.assert_array_equal(whole(recording), VALUES / 32768.0)
    blocks = list(recording.blocks(4 / 48_000))
    assert [(one.first_sample, len(one.samples), one.gap) for one in blocks] == [(0, 4, False), (4, 2, False)]
    assert blocks[1].t_ns == round(4 / 48_000 * 1e9)
    assert sum(one.clipped for one in blocks) == 2


def test_profile_circuit_and_time_are_taken_from_the_metadata(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        captures=[{"core:sample_start": 0, "core:datetime": "2026-11-22T00:00:00Z"}],
        trackcircuit__circuit_id="T12",
        trackcircuit__profile={"scheme": "fsk"},
    )
    recording = read_sigmf(path)
    assert (recording.circuit, recording.profile) == ("T12", b'{"scheme":"fsk"}')
    assert recording.stretches[0].t_ns == 1_795_305_600_000_000_000


def test_a_jump_of_the_converter_is_a_gap(tmp_path: Path) -> None:
    captures = [
        {"core:sample_start": 0, "core:global_index": 100},
        {"core:sample_start": 2, "core:global_index": 102},
        {"core:sample_start": 4, "core:global_index": 500},
    ]
    recording = read_sigmf(written(tmp_path, captures=captures))
    assert [(one.begin, one.end, one.first_sample) for one in recording.stretches] == [(0, 4, 100), (4, 6, 500)]
    assert [one.gap for one in recording.blocks(1.0)] == [False, True]


def test_a_channel_is_taken_out_of_several(tmp_path: Path) -> None:
    recording = read_sigmf(written(tmp_path, core__num_channels=2), channel=1)
    np.testing.assert_array_equal(whole(recording) * 32768.0, [1, 1000, 32767])
    with pytest.raises(SampleError, match="channel 2"):
        read_sigmf(tmp_path / "one.sigmf-meta", channel=2)


def test_cut_and_changed_samples_are_told_and_used(tmp_path: Path) -> None:
    raw = VALUES.astype("<i2").tobytes()
    path = written(tmp_path, raw=raw[:-1], core__sha512=hashlib.sha512(raw).hexdigest())
    recording = read_sigmf(path)
    assert len(recording.samples) == 5
    assert "cut within a sample" in recording.warnings[0]
    assert "SHA-512" in recording.warnings[1]
    (tmp_path / "one.sigmf-data").write_bytes(raw)
    assert read_sigmf(path).warnings == ()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"core__datatype": "cf32_le"}, "core:datatype"),
        ({"core__sample_rate": "fast"}, "core:sample_rate"),
        ({"core__sample_rate": 0}, "core:sample_rate"),
        ({"raw": b""}, "no samples"),
        ({"captures": [{"core:sample_start": 3}, {"core:sample_start": 1}]}, "must rise"),
        ({"captures": [{"core:sample_start": 0, "core:datetime": "noon"}]}, "ISO 8601"),
        ({"captures": [{"core:sample_start": 0, "core:header_bytes": 4}]}, "header"),
    ],
)
def test_metadata_that_cannot_be_meant_is_refused_by_name(tmp_path: Path, fields: dict[str, Any], words: str) -> None:
    path = written(tmp_path, **fields)
    with pytest.raises(SampleError, match=words) as refused:
        read_sigmf(path)
    assert str(tmp_path) in str(refused.value)


def test_what_is_no_json_is_refused_and_a_missing_file_named(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_bytes(b"{]")
    with pytest.raises(SampleError, match=r"one\.sigmf-meta"):
        read_sigmf(path)
    path.write_bytes(b"[]")
    with pytest.raises(SampleError, match="global"):
        read_sigmf(path)
    with pytest.raises(FileNotFoundError):
        read_sigmf(tmp_path / "two.sigmf-meta")


def wav(bits: int, body: bytes, *, kind: int = 1, channels: int = 1, announced: int | None = None) -> bytes:
    frame = channels * bits // 8
    header = struct.pack("<HHIIHH", kind, channels, 48_000, 48_000 * frame, frame, bits)
    if kind == 0xFFFE:
        header += struct.pack("<HHIH", 22, bits, 0, 1) + bytes(14)
    size = len(body) if announced is None else announced
    chunks = b"fmt " + struct.pack("<I", len(header)) + header + b"LIST" + struct.pack("<I", 3) + b"abc\0"
    chunks += b"data" + struct.pack("<I", size) + body
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks


@pytest.mark.parametrize(
    ("bits", "kind", "body"),
    [
        (16, 1, VALUES.astype("<i2").tobytes()),
        (16, 0xFFFE, VALUES.astype("<i2").tobytes()),
        (24, 1, b"".join((256 * value).to_bytes(3, "little", signed=True) for value in VALUES.tolist())),
        (32, 1, (VALUES.astype("<i4") * 65_536).astype("<i4").tobytes()),
        (32, 3, (VALUES / 32768.0).astype("<f4").tobytes()),
    ],
)
def test_wav_of_every_width_gives_the_same_samples(tmp_path: Path, bits: int, kind: int, body: bytes) -> None:
    path = tmp_path / "one.wav"
    path.write_bytes(wav(bits, body, kind=kind))
    recording = read_wav(path)
    assert (recording.sample_rate_hz, recording.warnings) == (48_000.0, ())
    np.testing.assert_array_equal(whole(recording), VALUES / 32768.0)


def test_a_cut_wav_is_read_with_a_warning_and_a_streamed_one_without(tmp_path: Path) -> None:
    path = tmp_path / "one.wav"
    body = VALUES.astype("<i2").tobytes()
    path.write_bytes(wav(16, body[:-3], announced=len(body)))
    assert (len(read_wav(path).samples), len(read_wav(path).warnings)) == (4, 1)
    path.write_bytes(wav(16, body, announced=0xFFFF_FFFF))
    assert (len(read_wav(path).samples), read_wav(path).warnings) == (6, ())


@pytest.mark.parametrize("content", [b"", b"RIFF", b"RIFF\0\0\0\0WAVEdata\4\0\0\0abcd", wav(8, b"abc"), wav(16, b"")])
def test_what_is_no_wav_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "one.wav"
    path.write_bytes(content)
    with pytest.raises(SampleError, match=r"one\.wav"):
        read_wav(path)


class Stdin:
    def __init__(self, content: bytes) -> None:
        self.buffer = io.BytesIO(content)


def test_raw_samples_come_on_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", Stdin(VALUES.astype("<i2").tobytes() + b"x"))
    recording = read_raw(96_000.0)
    np.testing.assert_array_equal(whole(recording), VALUES / 32768.0)
    assert (recording.sample_rate_hz, len(recording.warnings)) == (96_000.0, 1)
    monkeypatch.setattr("sys.stdin", Stdin(b""))
    with pytest.raises(SampleError, match="no samples"):
        read_raw(48_000.0)


def recorder(folder: Path, script: str) -> str:
    program = folder / "arecord"
    program.write_text("#!/bin/sh\n" + script)
    program.chmod(0o755)
    return str(program)


def test_a_sound_device_gives_its_channel_and_counts_what_it_lost(tmp_path: Path) -> None:
    program = recorder(
        tmp_path, "echo 'overrun!!! (at least 2.0 ms long)' >&2\nsleep 0.1\nprintf 'aAbBcCd'\nexec sleep 5"
    )
    stream = AlsaStream(AlsaInput(rate_hz=48_000, channels=2, channel=1), program)
    stream.open()
    samples, lost = np.empty(0), 0
    for _ in range(20):
        more, missing = stream.read()
        samples, lost = np.concatenate([samples, more]), lost + missing
        if len(samples) and lost:
            break
    stream.close()
    stream.close()
    np.testing.assert_allclose(samples * 32768.0, [ord("b") + 256 * ord("B")])
    assert lost == 96


def test_a_device_that_fails_says_why(tmp_path: Path) -> None:
    stream = AlsaStream(AlsaInput(), recorder(tmp_path, "echo 'audio open error: No such device' >&2\nexit 1"))
    stream.open()
    with pytest.raises(SourceError, match="No such device"):
        np.concatenate([stream.read()[0] for _ in range(20)])
    stream.close()
    with pytest.raises(SourceError, match="not installed"):
        AlsaStream(AlsaInput(), "no-such-recorder").open()
    with pytest.raises(SourceError, match="not open"):
        AlsaStream(AlsaInput()).read()
