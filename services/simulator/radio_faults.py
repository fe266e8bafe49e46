"""What can befall the radios of a line, and by how much a link suffers from it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from schemas.line import RadioSite
from services.simulator.motion_settings import Part

Floats = NDArray[np.float64]
RadioFaultKind = Literal["radio_interference", "radio_obstruction", "radio_snow", "radio_degradation", "radio_dead"]
DAY_S: Final = 86_400.0
USUAL_RADIO: Final[dict[RadioFaultKind, float]] = {
    "radio_interference": 30.0,
    "radio_obstruction": 15.0,
    "radio_snow": 8.0,
    "radio_degradation": 1.0,
    "radio_dead": 1.0,
}
"""Magnitude when none is given: dBm sent (EIRP), dB, dB, dB per day, 1 where there is nothing to measure."""


class Befalls(Part, frozen=True, kw_only=True):
    """Where a radio fault is; other faults have no place."""

    start_axis_m: float | None = None
    """None: from the line's beginning."""
    end_axis_m: float | None = None
    radio: str = ""
    """Id of a wayside radio; empty: every one (`radio_dead`: the train's own device)."""
    channel: str = ""
    """Empty: every one."""


ANYWHERE: Final = Befalls()


@dataclass(frozen=True, slots=True)
class RadioFault:
    """One fault, with when and where."""

    kind: RadioFaultKind
    magnitude: float
    where: Befalls = ANYWHERE
    since_s: float = -inf
    until_s: float = inf

    def hits(self, radio: str, channel: str) -> bool:
        """Whether it concerns the link to a radio on a channel."""
        return self.where.radio in ("", radio) and self.where.channel in ("", channel)

    def on(self, t_s: Floats) -> NDArray[np.bool_]:
        """Whether it is on at each time."""
        return np.asarray((t_s >= self.since_s) & (t_s < self.until_s))

    def inside(self, axis_m: Floats | float) -> NDArray[np.bool_]:
        """Which places lie in its stretch."""
        start_m, end_m = self.where.start_axis_m, self.where.end_axis_m
        place = np.asarray(axis_m)
        return np.asarray(
            (place >= (-inf if start_m is None else start_m)) & (place < (inf if end_m is None else end_m))
        )

    def place_m(self, length_m: float) -> float:
        """`axis_m` of what stands at one place: the middle of its stretch, or what of it is given."""
        start_m, end_m = self.where.start_axis_m, self.where.end_axis_m
        if start_m is None and end_m is None:
            return length_m / 2.0
        known = [one for one in (start_m, end_m) if one is not None]
        return sum(known) / len(known)


def loss_db(faults: tuple[RadioFault, ...], site: RadioSite, channel: str, t_s: Floats, axis_m: Floats) -> Floats:
    """What faults take from the link between a train at `axis_m` and a site [dB]; inf where it does not send.

    An obstruction stands between train and site while the train is in its stretch; snow lies on the antennas of the
    sites in its stretch; a degradation grows evenly with time.
    """
    loss = np.zeros_like(axis_m)
    for fault in faults:
        if not fault.hits(site.id, channel):
            continue
        on = fault.on(t_s)
        match fault.kind:
            case "radio_obstruction":
                loss += np.where(on & fault.inside(axis_m), fault.magnitude, 0.0)
            case "radio_snow":
                loss += np.where(on & fault.inside(site.axis_m), fault.magnitude, 0.0)
            case "radio_degradation":
                since_s = fault.since_s if np.isfinite(fault.since_s) else t_s
                loss += np.where(on, fault.magnitude * (t_s - since_s) / DAY_S, 0.0)
            case "radio_dead" if fault.where.radio:
                loss += np.where(on, inf, 0.0)
            case _:
                pass
    return loss


def silent(faults: tuple[RadioFault, ...], t_s: Floats) -> NDArray[np.bool_]:
    """When the train's own device says nothing: a dead device without the name of a wayside radio."""
    out = np.zeros(t_s.shape, bool)
    for fault in faults:
        if fault.kind == "radio_dead" and not fault.where.radio:
            out |= fault.on(t_s)
    return out
