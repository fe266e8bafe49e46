"""Bytes and messages: round trips, arrays without copies, refusals, and bytes of the past."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from schemas import topics
from schemas.arrays import array_from_extension, array_from_lists, array_to_extension, array_to_lists
from schemas.codec import (
    DecodeError,
    decode,
    decode_for_cli,
    decode_json,
    encode,
    encode_for_cli,
    encode_json,
    json_schema,
)
from schemas.gnss import Epoch, Fix
from schemas.topic import Topic
from tests.unit.schemas.examples import EXAMPLES

OLD_BYTES = Path(__file__).parent / "old_bytes"


@pytest.mark.parametrize("topic", topics.ALL, ids=lambda topic: topic.name)
def test_every_message_survives_msgpack_and_json(topic: Topic) -> None:  # type: ignore[type-arg]  # any
    message = EXAMPLES[topic.message]
    again = decode(topic.message, encode(message))
    assert encode(again) == encode(message)
    assert encode_json(decode_json(topic.message, encode_json(message))) == encode_json(message)


def without_new_fields(now: Any, kept: Any) -> Any:  # noqa: ANN401 - JSON
    """`now` without the fields that parts and messages have got since `kept` was written."""
    if isinstance(kept, dict):
        return {name: without_new_fields(now[name], kept[name]) for name in kept}
    if isinstance(kept, list) and isinstance(now, list) and len(now) == len(kept):
        return [without_new_fields(one, old) for one, old in zip(now, kept, strict=True)]
    return now


@pytest.mark.parametrize("topic", topics.ALL, ids=lambda topic: topic.name)
def test_bytes_written_by_earlier_versions_still_decode(topic: Topic) -> None:  # type: ignore[type-arg]  # any
    files = sorted(OLD_BYTES.glob(f"{topic.schema_name}.*.msgpack"))
    assert files, f"no kept bytes for {topic.schema_name}: write them with `python -m tests.unit.schemas.examples`"
    for file in files:
        kept = json.loads(file.with_suffix(".json").read_text("utf-8"))
        now = json.loads(encode_json(decode(topic.message, file.read_bytes())))
        assert without_new_fields(now, kept) == kept, file.name


@pytest.mark.parametrize("topic", topics.ALL, ids=lambda topic: topic.name)
def test_schema_describes_every_field(topic: Topic) -> None:  # type: ignore[type-arg]  # any
    schema = json_schema(topic.message)
    properties = schema["$defs"][topic.message.__name__]["properties"]
    assert set(properties) == set(topic.message.__struct_fields__)


@given(
    npst.arrays(
        dtype=st.sampled_from([np.float64, np.float32, np.uint8, np.int64, np.complex128, np.bool_]),
        shape=npst.array_shapes(min_dims=0, max_dims=3, min_side=0),
    )
)
def test_arrays_travel_unchanged_and_uncopied(array: NDArray[np.generic]) -> None:
    extension = array_to_extension(array)
    back = array_from_extension(extension.code, memoryview(extension.data))
    assert back.dtype == array.dtype
    assert back.shape == array.shape
    assert back.tobytes() == array.tobytes()
    assert not back.flags.writeable
    assert back.size == 0 or not back.flags.owndata


def test_decoding_an_epoch_copies_no_column() -> None:
    payload = encode(EXAMPLES[Epoch])
    epoch = decode(Epoch, payload)
    base = np.frombuffer(payload, np.uint8)
    assert np.shares_memory(base, epoch.pseudorange_m)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=False), max_size=5))
def test_missing_elements_are_null_in_json(values: list[float]) -> None:
    text = json.loads(msgspec.json.encode(array_to_lists(np.array(values))))
    assert [value is None for value in text] == [math.isnan(value) for value in values]
    np.testing.assert_array_equal(array_from_lists(text), np.array(values))


def test_complex_numbers_are_pairs_in_json() -> None:
    assert array_to_lists(np.array([1 + 2j])) == [[1.0, 2.0]]


def test_objects_never_travel() -> None:
    with pytest.raises(TypeError, match="cannot travel"):
        array_to_extension(np.array([object()]))
    with pytest.raises(msgspec.ValidationError):
        array_from_extension(1, memoryview(b"\x02|O\x01\x01\x00\x00\x00" + b"\x00" * 8))


@given(st.binary(max_size=64))
def test_garbage_is_a_decode_error_and_nothing_else(octets: bytes) -> None:
    try:
        decode(Epoch, octets)
    except DecodeError:
        return
    pytest.fail("64 random bytes cannot be an epoch")


@given(st.integers(0, 400), st.integers(0, 255))
def test_a_damaged_epoch_decodes_or_is_refused(where: int, octet: int) -> None:
    payload = bytearray(encode(EXAMPLES[Epoch]))
    payload[where % len(payload)] = octet
    try:
        epoch = decode(Epoch, bytes(payload))
    except DecodeError:
        return
    assert epoch.pseudorange_m.shape == (len(epoch.satellites),)


def test_columns_of_different_lengths_are_refused() -> None:
    example = EXAMPLES[Epoch]
    fields = msgspec.structs.asdict(example)
    fields["doppler_hz"] = np.zeros(7)
    with pytest.raises(DecodeError, match="doppler_hz must be 2 values"):
        decode(Epoch, msgspec.msgpack.encode(fields, enc_hook=array_to_extension))
    fields["doppler_hz"] = np.zeros(2, np.float32)
    with pytest.raises(DecodeError, match="float32"):
        decode(Epoch, msgspec.msgpack.encode(fields, enc_hook=array_to_extension))


def test_a_message_of_a_newer_schema_is_understood() -> None:
    fields = msgspec.structs.asdict(EXAMPLES[Fix]) | {"a_field_of_tomorrow": {"deep": [1, 2]}}
    assert decode(Fix, msgspec.msgpack.encode(fields)) == EXAMPLES[Fix]


def test_ten_megabytes_are_refused_before_decoding() -> None:
    with pytest.raises(DecodeError, match="10000000 bytes"):
        decode(Fix, b"\x80" * 10_000_000)


def test_the_zenoh_command_line_sees_json_or_the_reason() -> None:
    key = "kirotei/v1/demo/train/T1/gnss/front/fix"
    text = decode_for_cli(key, encode(EXAMPLES[Fix]))
    assert json.loads(text)["method"] == "adjust"
    assert decode(Fix, encode_for_cli(key, text)) == EXAMPLES[Fix]
    assert "no Kirotei topic" in decode_for_cli("other/key", b"")
    assert "cannot decode" in decode_for_cli(key, b"\xc1")
    with pytest.raises(DecodeError, match="no Kirotei topic"):
        encode_for_cli("other/key", "{}")
