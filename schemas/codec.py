"""Messages to bytes and back: one encoder and one typed decoder per topic, built once.

The wire format is msgpack with the message's field names as keys. `decode_for_cli` and
`encode_for_cli` are entry points of the `zenoh` command line (`--decoder kirotei`); they
see only key and bytes and find the topic from the key.
"""

from __future__ import annotations

import inspect
from functools import cache
from typing import Any, TypeVar, get_args, get_origin

import msgspec
import numpy as np

from schemas.arrays import array_from_extension, array_from_lists, array_to_extension, array_to_lists
from schemas.message import Message
from schemas.topics import topic_of

M = TypeVar("M", bound=Message)
MAX_MESSAGE_BYTES = 1024 * 1024
"""Larger payloads are refused before decoding. Keep messages under 64 kB: larger ones are lost on bursts."""


class DecodeError(ValueError):
    """Bytes that are not a message of their topic."""


def _is_array(wanted: Any) -> bool:  # noqa: ANN401 - msgspec hands over any type
    return wanted is np.ndarray or get_origin(wanted) is np.ndarray


def _to_wire(value: object) -> object:
    if isinstance(value, np.ndarray):
        return array_to_extension(value)
    if isinstance(value, np.generic):
        return value.item()
    msg = f"a {type(value).__name__} cannot travel in a message"
    raise TypeError(msg)


def _to_json(value: object) -> object:
    if isinstance(value, np.ndarray):
        return array_to_lists(value)
    if isinstance(value, np.generic):
        return value.item()
    msg = f"a {type(value).__name__} cannot be shown as JSON"
    raise TypeError(msg)


def _from_wire(wanted: Any, value: object) -> object:  # noqa: ANN401 - msgspec hands over any type
    if _is_array(wanted) and isinstance(value, np.ndarray):
        return value
    msg = f"expected {wanted}, got {type(value).__name__}"
    raise TypeError(msg)


def _from_json(wanted: Any, value: object) -> object:  # noqa: ANN401 - msgspec hands over any type
    if _is_array(wanted) and isinstance(value, list):
        dtype = get_args(get_args(wanted)[1])[0] if get_args(wanted) else np.float64
        return array_from_lists(value, dtype)
    msg = f"expected {wanted}, got {type(value).__name__}"
    raise TypeError(msg)


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_to_wire)
_JSON_ENCODER = msgspec.json.Encoder(enc_hook=_to_json)
encode = _ENCODER.encode
"""Msgpack bytes of any message."""


def encode_json(message: Message) -> bytes:
    """JSON of a message, arrays as lists, NaN as null."""
    return _JSON_ENCODER.encode(message)


@cache
def decoder_of(message: type[M]) -> msgspec.msgpack.Decoder[M]:
    """Typed msgpack decoder of a message type, built once. Raises msgspec's own errors: see `decode`."""
    return msgspec.msgpack.Decoder(message, ext_hook=array_from_extension, dec_hook=_from_wire)


def decode(message: type[M], payload: bytes | memoryview) -> M:
    """Message in `payload`. Everything that can be wrong with it becomes one DecodeError."""
    if len(payload) > MAX_MESSAGE_BYTES:
        msg = f"{message.__name__}: {len(payload)} bytes, more than the {MAX_MESSAGE_BYTES} accepted"
        raise DecodeError(msg)
    try:
        decoded: M = decoder_of(message).decode(payload)
    except (msgspec.MsgspecError, ValueError, TypeError, OverflowError, RecursionError) as error:
        msg = f"{message.__name__}: {error}"
        raise DecodeError(msg) from error
    return decoded


def decode_json(message: type[M], text: bytes | str) -> M:
    """Message in a JSON text. Raises DecodeError."""
    try:
        return msgspec.json.decode(text, type=message, dec_hook=_from_json)
    except (msgspec.MsgspecError, ValueError, TypeError, OverflowError, RecursionError) as error:
        msg = f"{message.__name__}: {error}"
        raise DecodeError(msg) from error


def json_schema(message: type[Message]) -> dict[str, Any]:
    """JSON schema of a message; arrays are lists of numbers, or of pairs where they are complex."""

    def describe(wanted: Any) -> dict[str, Any]:  # noqa: ANN401 - msgspec hands over any type
        if _is_array(wanted):
            return {"type": "array", "items": {"type": ["number", "null", "array"]}}
        msg = f"no JSON schema for {wanted}"
        raise NotImplementedError(msg)  # msgspec's own word for a type that the hook does not know

    schema = msgspec.json.schema(message, schema_hook=describe)
    schema.setdefault("description", inspect.getdoc(message) or "")
    return schema


def decode_for_cli(key: object, value: bytes) -> str:
    """One line of JSON for the `zenoh` command; says what is wrong instead of raising."""
    address = topic_of(str(key))
    if address is None:
        return f"[no Kirotei topic has this key; {len(value)} bytes]"
    try:
        return encode_json(decode(address.topic.message, bytes(value))).decode()
    except DecodeError as error:
        return f"[cannot decode: {error}]"


def encode_for_cli(key: object, value: str) -> bytes:
    """Msgpack of a JSON text for the `zenoh` command's `put`. Raises DecodeError."""
    address = topic_of(str(key))
    if address is None:
        msg = f"no Kirotei topic has the key {key}"
        raise DecodeError(msg)
    return encode(decode_json(address.topic.message, value))
