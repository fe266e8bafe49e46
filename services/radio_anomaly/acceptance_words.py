"""An acceptance out of what a person types."""

from __future__ import annotations

import zlib
from datetime import UTC, datetime

from schemas.radio import Direction, RadioAcceptance
from services.radio_anomaly.reading import EARLIEST_NS, LATEST_NS


def accepted(
    *,
    radio: str,
    channel: str,
    direction: Direction | None,
    start_m: float,
    end_m: float,
    since: str,
    by: str,
    why: str,
) -> RadioAcceptance:
    """A word whose name follows from its content, so that saying it twice is saying it once. Raises ValueError."""
    try:
        begin = datetime.fromisoformat(since)
    except ValueError:
        msg = f"since {since!r} is no date: write 2026-11-22"
        raise ValueError(msg) from None
    begin = begin.replace(tzinfo=UTC) if begin.tzinfo is None else begin
    since_ns = int(begin.timestamp()) * 1_000_000_000
    if not EARLIEST_NS <= since_ns < LATEST_NS:
        msg = f"since {since} is not between 2000 and 2034"
        raise ValueError(msg)
    if not by:
        msg = "say who accepts it"
        raise ValueError(msg)
    content = f"{radio}/{channel}/{direction}/{start_m}/{end_m}/{since_ns}"
    return RadioAcceptance(
        t_ns=since_ns,
        acceptance_id=f"{zlib.crc32(content.encode()):08x}",
        radio=radio,
        channel=channel,
        direction=direction,
        section_start_m=start_m,
        section_end_m=end_m,
        since_ns=since_ns,
        by=by,
        why=why,
    )
