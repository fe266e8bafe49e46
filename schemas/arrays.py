"""Numpy arrays inside messages: raw bytes in msgpack, lists in JSON.

On the wire an array is a msgpack extension (type 1): one byte dtype-string length, the
dtype string ('<f8'), one byte number of dimensions, each dimension as four bytes
little-endian, then the raw bytes in C order. Decoding makes a read-only view of the
received buffer; it copies nothing and is usually unaligned.

A missing element of a float array is NaN inside a service and on the wire (an array has
no null); in JSON it is null, and a complex number is a [real, imaginary] pair.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
from msgspec import ValidationError
from msgspec.msgpack import Ext
from numpy.typing import NDArray

ARRAY_EXTENSION = 1
MAX_ARRAY_BYTES = 64 * 1024 * 1024
MAX_DIMENSIONS = 8
_KINDS = frozenset("biufc")

Float64s = NDArray[np.float64]
"""One-dimensional float64 array; NaN where a value is missing."""
Int64s = NDArray[np.int64]
"""One-dimensional int64 array."""
Uint8s = NDArray[np.uint8]
"""One-dimensional uint8 array."""
Float32s = NDArray[np.float32]
"""One-dimensional float32 array."""
Complex128s = NDArray[np.complex128]
"""One-dimensional complex128 array."""


def array_to_extension(array: NDArray[Any]) -> Ext:
    """Msgpack extension that holds `array` (any shape, numeric or boolean dtype).

    Raises TypeError for object, string and structured dtypes.
    """
    if array.dtype.kind not in _KINDS or array.dtype.hasobject:
        msg = f"an array of dtype {array.dtype} cannot travel; use a numeric dtype"
        raise TypeError(msg)
    little = array.astype(array.dtype.newbyteorder("<"), copy=False)
    dtype = little.dtype.str.encode("ascii")
    head = struct.pack(f"<B{len(dtype)}sB{little.ndim}I", len(dtype), dtype, little.ndim, *little.shape)
    return Ext(ARRAY_EXTENSION, head + little.tobytes())


def array_from_extension(code: int, payload: memoryview) -> NDArray[Any]:
    """Read-only view of the array in a msgpack extension, without a copy.

    Raises ValidationError when the extension is not ours, is cut short, names a dtype
    that is not numeric, or is larger than 64 MiB.
    """
    if code != ARRAY_EXTENSION:
        msg = f"unknown msgpack extension type {code}"
        raise ValidationError(msg)
    if len(payload) > MAX_ARRAY_BYTES:
        msg = f"array of {len(payload)} bytes is larger than {MAX_ARRAY_BYTES}"
        raise ValidationError(msg)
    try:
        length = payload[0]
        dtype = np.dtype(bytes(payload[1 : 1 + length]).decode("ascii"))
        ndim = payload[1 + length]
        if dtype.kind not in _KINDS or dtype.hasobject or ndim > MAX_DIMENSIONS:
            msg = f"array of dtype {dtype} with {ndim} dimensions is not accepted"
            raise ValidationError(msg)
        start = 2 + length + 4 * ndim
        shape = struct.unpack_from(f"<{ndim}I", payload, 2 + length)
        if math.prod(shape) * dtype.itemsize != len(payload) - start:
            msg = f"array of shape {shape} and dtype {dtype} does not fit {len(payload) - start} bytes"
            raise ValidationError(msg)
        return np.frombuffer(payload[start:], dtype=dtype).reshape(shape)
    except (IndexError, TypeError, ValueError, SyntaxError, struct.error) as error:
        if isinstance(error, ValidationError):
            raise
        msg = f"array extension is malformed: {error}"
        raise ValidationError(msg) from error


def array_to_lists(array: NDArray[Any]) -> list[Any]:
    """Nested lists for JSON; complex numbers become [real, imaginary] pairs."""
    if array.dtype.kind == "c":
        array = np.stack([array.real, array.imag], axis=-1)
    lists: list[Any] = array.tolist()
    return lists


def array_from_lists(lists: list[Any], dtype: type[np.generic] = np.float64) -> NDArray[Any]:
    """Array of the lists that `array_to_lists` made; null becomes NaN, pairs become complex numbers.

    Integers stay integers only if `dtype` asks for them. Raises ValueError for complex numbers that are no pairs.
    """
    numbers = np.array(lists, dtype=np.float64)
    if np.issubdtype(dtype, np.complexfloating):
        pairs = numbers.reshape(0, 2) if numbers.size == 0 else numbers
        if pairs.shape[-1] != 2:  # noqa: PLR2004 - real and imaginary part
            msg = "a complex number is a pair of numbers"
            raise ValueError(msg)
        return np.ascontiguousarray(pairs).view(np.complex128)[..., 0].astype(dtype)
    return numbers.astype(dtype)
