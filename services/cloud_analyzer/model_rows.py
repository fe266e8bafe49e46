"""Models of the radio as rows of the store: a line about each, and its content in parts."""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

from schemas.radio import RadioEvent
from services.cloud_analyzer.tables import Value
from services.radio_anomaly.radio_model import RadioModel
from services.radio_anomaly.radio_model_file import encoded_model

PART_CHARACTERS: Final = 262_144
"""Of base64: some parts go into a message."""
GZIP_WBITS: Final = 31
"""For zlib: gzip's frame, with no time in it, so that the same model gives the same bytes."""


class Learning(msgspec.Struct, frozen=True, kw_only=True):
    """A model as it is kept, and what is told about it beside."""

    model: RadioModel
    from_ns: int
    through_ns: int
    """All passes that began in between were learned, or judged and learned where normal."""
    based_on: str = ""
    """Version that it goes on from; empty when it was learned anew."""


def packed_model(model: RadioModel) -> bytes:
    """Content of the model's file, packed by gzip."""
    packer = zlib.compressobj(6, wbits=GZIP_WBITS)
    return packer.compress(encoded_model(model)) + packer.flush()


def version_of(model: RadioModel) -> str:
    """Name of a model: its last day and what it holds. The same model has the same name everywhere.

    >>> version_of(RadioModel())[:6], version_of(RadioModel()) == version_of(RadioModel())
    ('empty-', True)
    """
    digest = hashlib.sha256(msgspec.json.encode(model)).hexdigest()
    return f"{model.origin.last_utc or 'empty'}-{digest[:12]}"


def model_rows(learning: Learning, line: str, now_ns: int) -> tuple[tuple[Value, ...], tuple[tuple[Value, ...], ...]]:
    """Row of `models`, and rows of `model_parts`."""
    model, packed = learning.model, packed_model(learning.model)
    version, origin, evidence = version_of(model), model.origin, model.evidence
    text = base64.b64encode(packed).decode()
    parts = [text[first : first + PART_CHARACTERS] for first in range(0, len(text), PART_CHARACTERS)]
    about = (
        now_ns,
        line,
        version,
        learning.based_on,
        model.method,
        learning.from_ns,
        learning.through_ns,
        origin.first_utc,
        origin.last_utc,
        origin.passes,
        origin.readings,
        0 if evidence is None else evidence.cells,
        None if evidence is None else evidence.rate,
        None if evidence is None else evidence.rate_high,
        len(packed),
        hashlib.sha256(packed).hexdigest(),
        len(parts),
    )
    return about, tuple((now_ns, line, version, number, part) for number, part in enumerate(parts))


class IncompleteModelError(ValueError):
    """Not all of a model is there, or it is not what it was."""


def content_of(parts: Iterable[str], sha256: str) -> bytes:
    """Packed content in its parts, in order. Raises IncompleteModelError."""
    try:
        packed = base64.b64decode("".join(parts), validate=True)
    except ValueError as error:
        msg = f"the model's parts are damaged: {error}"
        raise IncompleteModelError(msg) from error
    found = hashlib.sha256(packed).hexdigest()
    if found != sha256:
        msg = f"the model's parts have {len(packed)} bytes of {found[:12]}…, not of {sha256[:12]}…"
        raise IncompleteModelError(msg)
    return packed


def event_rows(events: Sequence[RadioEvent], line: str, version: str, analysis: str) -> tuple[tuple[Value, ...], ...]:
    """Rows of `reanalysed`."""
    return tuple(
        (
            event.t_ns,
            line,
            version,
            analysis,
            number,
            event.event_id,
            event.phase,
            event.kind,
            event.cause,
            event.radio,
            event.channel,
            event.direction or "",
            event.section_start_m,
            event.section_end_m,
            int(event.confirmed),
            event.pass_id,
            msgspec.json.encode(event).decode(),
        )
        for number, event in enumerate(events)
    )
