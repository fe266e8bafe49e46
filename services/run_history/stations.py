"""Stations by what people call them."""

from __future__ import annotations

from schemas.line import Line, Station


class UnknownStationError(ValueError):
    """No station, or several, are called so."""


def station_named(line: Line, called: str) -> Station:
    """Station by id, name or Japanese name. Raises UnknownStationError naming those there are."""
    found = [one for one in line.stations if called in (one.id, one.name, one.name_ja)]
    if len(found) != 1:
        known = ", ".join(one.name for one in line.stations)
        several = "several stations are" if found else "no station is"
        msg = f"{several} called {called!r}; there are: {known}"
        raise UnknownStationError(msg)
    return found[0]
