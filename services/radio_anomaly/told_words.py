"""A model and an analysis in lines for people: what is open in one line an incident, and the events in a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from schemas.radio import RadioEvent
from services.radio_anomaly.file_analysis import Analysis
from services.radio_anomaly.incidents import words_of
from services.radio_anomaly.radio_model import RadioModel

TABLE_ROWS: Final = 40
NAMED_PASSES: Final = 5


def model_words(model: RadioModel) -> Iterator[str]:
    """What a model was learned from, and its share of normal pass-sections reported."""
    origin, evidence = model.origin, model.evidence
    if origin.passes:
        yield (f"learned {origin.readings} readings of {origin.passes} passes, {origin.first_utc} to {origin.last_utc}")
    if model.method == "paper":
        yield "method paper: no held-out false-alarm rate"
        return
    if evidence is not None and evidence.rate is not None and evidence.rate_high is not None:
        yield (
            f"held out in {evidence.folds} folds: {evidence.reported} of {evidence.cells} normal pass-sections "
            f"reported, {evidence.rate:.2%} (95 %: up to {evidence.rate_high:.2%})"
        )
    elif model.alarms.rate is None:
        yield "too few passes for a held-out false-alarm rate"
    if model.alarms.rate is not None:
        yield (
            f"judged before they were learned, {model.alarms.passes} passes: {model.alarms.rate:.2%} of pass-sections "
            "reported, the first passes of real faults among them"
        )
    if evidence is not None and evidence.suspicious:
        more = f" and {len(evidence.suspicious) - NAMED_PASSES} more" if len(evidence.suspicious) > NAMED_PASSES else ""
        names = ", ".join(evidence.suspicious[:NAMED_PASSES])
        yield f"not like the others, was everything normal on them? {names}{more}"


def open_incidents(model: RadioModel) -> Iterator[str]:
    """What is open and confirmed, a line an incident."""
    sure = [one for one in model.events if one.confirmed]
    for name in dict.fromkeys(one.incident_id or one.event_id for one in sure):
        words = words_of(name, model.events, model.settings.section_m)
        yield f"open: {words or name}"
    if not sure:
        yield "nothing open that is confirmed"


def analysis_words(found: Analysis, model: RadioModel) -> Iterator[str]:
    """Counts, then incidents, then the table of events."""
    events = [one for one in found.events if one.phase != "ended"]
    incidents = incident_rows(events)
    rate = "" if model.evidence is None or model.evidence.rate is None else f"; held out {model.evidence.rate:.2%}"
    yield f"{found.passes} passes, {len({one.event_id for one in events})} events in {len(incidents)} incidents{rate}"
    if found.model.alarms.rate is not None:
        yield (
            f"judged before they were learned: {found.model.alarms.rate:.2%} of pass-sections reported, "
            "the first passes of real faults among them"
        )
    for name, count in sorted(found.learning.items()):
        yield f"learning {name}: too few passes known, nothing raised on {count}"
    yield from incidents[:TABLE_ROWS]
    if len(incidents) > TABLE_ROWS:
        yield f"… and {len(incidents) - TABLE_ROWS} more incidents in the file"
    for event in events[:TABLE_ROWS]:
        sure = "" if event.confirmed else "?"
        yield (
            f"{event.pass_id}  {event.radio} {event.channel} {event.direction or '-'}  "
            f"{event.section_start_m:.0f}-{event.section_end_m:.0f} m  {event.kind}{sure} {event.phase}  "
            f"{event.cause}: {event.reason}"
        )
    if len(events) > TABLE_ROWS:
        yield f"… and {len(events) - TABLE_ROWS} more in the file"


def incident_rows(events: Sequence[RadioEvent]) -> list[str]:
    """A line for each incident with a confirmed event: its first and last pass, and what it came to."""
    rows = []
    sure = [one for one in events if one.confirmed and one.incident_id]
    for name in dict.fromkeys(one.incident_id for one in sure):
        mine = [one for one in sure if one.incident_id == name]
        passes = list(dict.fromkeys(one.pass_id for one in mine))
        span = passes[0] if len(passes) == 1 else f"{passes[0]} to {passes[-1]}, {len(passes)} passes"
        rows.append(f"incident {span}: {mine[-1].incident}")
    return rows
