"""Messages of RTCM 3 with fixed fields: read by pyrtcm, written from pyrtcm's own field tables.

Source: RTCM 10403.3, 3.3 and 3.4.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pyrtcm import RTCMMessage
from pyrtcm.exceptions import (
    ParameterError,
    RTCMMessageError,
    RTCMParseError,
    RTCMStreamError,
    RTCMTypeError,
)
from pyrtcm.rtcmtypes_core import INT, INTS, RTCM_DATA_FIELDS
from pyrtcm.rtcmtypes_get import RTCM_PAYLOADS_GET

from services.gnss_receiver.bit_fields import BitWriter
from services.gnss_receiver.crc24q import crc24q

NUMBER: Final = "DF002"
LONGEST: Final = 1023
"""Bytes of a message that a frame can hold."""
_ERRORS: Final = (ParameterError, RTCMMessageError, RTCMParseError, RTCMStreamError, RTCMTypeError)


def number_of(message: bytes) -> int:
    """Number of a message; 0 when it is too short to have one."""
    return message[0] << 4 | message[1] >> 4 if len(message) > 1 else 0


def read_fields(message: bytes) -> dict[str, float]:
    """Scaled fields of a message by their names in the standard ('DF009').

    Raises ValueError when pyrtcm cannot read it, or when it is shorter than its fields.
    """
    number = number_of(message)
    wanted = sum(RTCM_DATA_FIELDS[name][1] for name in RTCM_PAYLOADS_GET[str(number)])
    if 8 * len(message) < wanted:
        msg = f"message {number} has {len(message)} bytes, its fields need {-(-wanted // 8)}"
        raise ValueError(msg)
    try:
        read = RTCMMessage(payload=message)
    except _ERRORS as error:
        msg = f"message {number} cannot be read: {error}"
        raise ValueError(msg) from error
    return {name: getattr(read, name) for name in RTCM_PAYLOADS_GET[str(number)]}


def write_fields(number: int, values: Mapping[str, float]) -> bytes:
    """Message of scaled fields by their names; fields without a value are zero.

    Raises ValueError, naming the field, for a value that it cannot hold.
    """
    writer = BitWriter()
    for name in RTCM_PAYLOADS_GET[str(number)]:
        kind, width, scale, about = RTCM_DATA_FIELDS[name]
        value = number if name == NUMBER else values.get(name, 0)
        whole = round(value / scale) if scale else round(value)
        try:
            if kind == INT:
                writer.sint(whole, width)
            elif kind == INTS:
                writer.magnitude(whole, width)
            else:
                writer.uint(whole, width)
        except ValueError as error:
            msg = f"{name} ({about}) of message {number}: {error}"
            raise ValueError(msg) from error
    return writer.content()


def framed(message: bytes) -> bytes:
    """Frame around a message: preamble, length and check. Raises ValueError for one that is too long."""
    if len(message) > LONGEST:
        msg = f"a message of {len(message)} bytes does not fit into a frame of {LONGEST}"
        raise ValueError(msg)
    frame = b"\xd3" + len(message).to_bytes(2, "big") + message
    return frame + crc24q(frame).to_bytes(3, "big")
