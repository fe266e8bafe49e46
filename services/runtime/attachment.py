"""What rides beside every payload: who sent it, since which start, as which number, when."""

from __future__ import annotations

from typing import Annotated

import msgspec


class Attachment(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Sender's mark on one publication; msgpack array of four."""

    source: str
    """Place and instance, 'demo/train/T1/gnss_receiver'."""
    boot_id: str
    """Made anew at every start of the sender."""
    sequence: Annotated[int, msgspec.Meta(ge=0)]
    """Counts from 0 per key and start."""
    sent_ns: int
    """UTC in Unix nanoseconds by the sender's clock."""


UNMARKED = Attachment("", "", -1, 0)
"""Stands for the mark of a sender who set none."""

_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(Attachment)
encode_attachment = _ENCODER.encode


def decode_attachment(octets: bytes) -> Attachment | None:
    """Attachment in `octets`; None when they are not one (a foreign sender)."""
    try:
        return _DECODER.decode(octets)
    except (msgspec.MsgspecError, ValueError, OverflowError, RecursionError):
        # ValueError: text that is not UTF-8.
        return None
