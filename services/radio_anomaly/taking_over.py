"""A model that was handed down, taken over by a watch that has learned since: the newer one counts, nothing twice.

A model's version is how far it was learned from files or from a history, its origin; what a watch learns on its own
does not change that. So a model is newer than the kept one when it was learned from later days, or from more passes of
the same days, than the one which the kept one began with.
"""

from __future__ import annotations

import msgspec

from schemas.radio import BinSums, RadioAcceptance
from services.radio_anomaly.radio_model import Origin, RadioModel


def why_not(given: RadioModel, kept: RadioModel) -> str | None:
    """Why a model is not taken over, in words; None where it is newer, or the one that the kept one began with."""
    if given.method != "line":
        return f"the service works by the method `line`, not `{given.method}`"
    if given.settings.section_m != kept.settings.section_m:
        return f"its sections are of {given.settings.section_m:g} m, those kept of {kept.settings.section_m:g} m"
    if _version(given.origin) < _version(kept.origin):
        return (
            f"learned until {given.origin.last_utc or 'never'} from {given.origin.passes} passes, "
            f"older than the one kept, until {kept.origin.last_utc} from {kept.origin.passes}"
        )
    return None


def is_newer(given: RadioModel, kept: RadioModel) -> bool:
    """Whether it was learned from later or more than the one that the kept one began with."""
    return _version(given.origin) > _version(kept.origin)


def taken_over(given: RadioModel, kept: RadioModel) -> RadioModel:
    """The given model, with what the kept one alone knows.

    That is what it learned or withheld on days after the given one's last, words of acceptance, open events, what
    was silent last, radios that the given one never heard of, and what the bus may say again. Windows and trends are
    remembered against the old means, and are not kept.
    """
    until = given.origin.last_utc
    known = {(one.radio, one.channel) for one in given.streams}
    words: list[RadioAcceptance] = list(given.acceptances)
    words += [word for word in kept.acceptances if word not in words]

    def since(rows: tuple[BinSums, ...]) -> tuple[BinSums, ...]:
        return tuple(row for row in rows if row.day > until or (row.radio, row.channel) not in known)

    return msgspec.structs.replace(
        given,
        sums=given.sums + since(kept.sums),
        withheld=given.withheld + since(kept.withheld),
        streams=given.streams + tuple(one for one in kept.streams if (one.radio, one.channel) not in known),
        silent=kept.silent,
        events=kept.events,
        acceptances=tuple(sorted(words, key=lambda word: word.t_ns)),
        pending=given.pending + tuple(one for one in kept.pending if one.journey.day > until),
        heard_until=kept.heard_until,
        telling=kept.telling,
    )


def _version(origin: Origin) -> tuple[str, int, int]:
    return origin.last_utc, origin.passes, origin.readings
