"""Pseudoranges corrected by a reference station.

    P' = P + PRC + RRC (t - t0) + A_s

PRC and RRC are the station's correction and its rate for the satellite, A_s what the models of the
air say at the *station*. The solvers then take out what the same models say at the receiver, as from
every pseudorange: what remains is the difference of the models between both places, zero at the
station, and the models' errors are taken out with all else that both places share. Both sides of that
difference use the receiver's own coefficients, so that it does not matter which ones the station has.

A correction holds for the ephemeris from which it was made, for its signal, and for a while. An
epoch is corrected as a whole or not at all: if enough of its satellites have corrections and stand
well, the others are left out; else none is corrected. Mixed, the errors that the corrections take
out would stand against those that they leave.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Corrections
from schemas.gnss_time import WEEK_S
from services.gnss_correction.correction_set import CorrectionSet, check, correction_set
from services.gnss_correction.ephemeris_table import EphemerisTable
from services.gnss_correction.other_signals import SignalAverages, centred, signal_differences
from services.gnss_correction.preparation import Prepared
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.solver_arrays import Float64s, Records
from services.gnss_correction.station_sight import lines_enu, see_from
from services.gnss_receiver.observations import Observations

AHEAD_S: Final = 1e-3
"""A station's clock may be ahead of a receiver's by so much and its corrections still be of the same instant."""
SPARE: Final = 1
"""Corrected satellites beyond the unknowns that an epoch needs to be corrected."""
LARGEST_PDOP: Final = 8.0
"""Of the corrected satellites: with a worse geometry than this the others are needed more than the corrections."""
AGEING_MPS: Final = 0.01
"""Growth of a correction's standard deviation: the air under strong gradients changes by about so much."""
COMMON_AT_STATION_M: Final = 0.3
COMMON_PER_M: Final = 4e-6
"""What corrected satellites share: the reflections of the reference antenna, and gradients of the air, which under
strong storms of the ionosphere reach millimetres per kilometre for every metre of delay (Datta-Barua et al. 2010)."""
MOST_SETS: Final = 100_000
"""A day at 1 Hz; beyond, the oldest are dropped."""
_USABLE, _UNCORRECTED = int(Rejection.USABLE), int(Rejection.UNCORRECTED)
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Differential:
    """What became of the corrections in a block."""

    epochs: Sequence[str]
    """For each epoch why it is not corrected; empty where it is, or where nobody gives corrections."""
    rows: dict[int, str]
    """For rows of corrected epochs that have no correction, why."""


class CorrectionTable:
    """The latest corrections of one reference station, and the satellites' corrections at any time."""

    def __init__(self, longest_age_s: float, smooth_s: float = 0.0) -> None:
        """Have heard of no station; further signals are averaged over `smooth_s`."""
        self._signals = SignalAverages(smooth_s)
        self.longest_age_s = longest_age_s
        self._sets: list[CorrectionSet] = []

    def __bool__(self) -> bool:
        """Whether a station has ever been heard."""
        return bool(self._sets)

    def add(self, message: Corrections) -> str:
        """Take a message in; gives why it is refused, empty when it is not.

        While one station speaks others are not listened to. Raises nothing.
        """
        try:
            new = correction_set(message)
        except ValueError as error:
            return str(error)
        if self._sets:
            latest = self._sets[-1]
            other = new.station_name != latest.station_name
            if other and new.gps_s - latest.gps_s <= self.longest_age_s:
                return f"station {latest.station_name} speaks already"
            if other:
                self._sets.clear()
            elif new.gps_s <= latest.gps_s:
                return "repeated or late"
        self._sets.append(new)
        del self._sets[:-MOST_SETS]
        return ""

    def common_m(self, place_m: Float64s) -> Float64s:
        """Horizontal error [m] that corrected satellites share at places (n, 3), Earth-fixed; NaN without a station."""
        if not self._sets:
            return np.full(len(place_m), np.nan)
        away_m = np.linalg.norm(place_m - self._sets[-1].station.place_m, axis=1)
        return np.asarray(COMMON_AT_STATION_M + COMMON_PER_M * away_m)

    def _forget_before(self, gps_s: float) -> None:
        """Drop what is too old at `gps_s` and later; the latest set is kept, so that its age can be told."""
        keep = bisect_right(self._sets, gps_s - self.longest_age_s, key=lambda one: one.gps_s)
        del self._sets[: min(keep, len(self._sets) - 1)]

    def _at(self, gps_s: float) -> list[CorrectionSet]:
        """Sets that may be used at a time, the latest first."""
        last = bisect_right(self._sets, gps_s + AHEAD_S, key=lambda one: one.gps_s)
        first = bisect_right(self._sets, gps_s - self.longest_age_s - AHEAD_S, key=lambda one: one.gps_s)
        return self._sets[first:last][::-1]

    def _why_none(self, gps_s: float) -> str:
        """Why no set may be used at a time."""
        last = bisect_right(self._sets, gps_s + AHEAD_S, key=lambda one: one.gps_s)
        return (
            f"no corrections: the last are {gps_s - self._sets[last - 1].gps_s:.0f} s old"
            if last
            else "no corrections yet"
        )

    def apply(
        self, prepared: Prepared, observations: Observations, table: EphemerisTable, rules: np.void
    ) -> Differential:
        """Fill the corrections of a block's rows in place, and leave out rows without where others have one."""
        epochs, rows = [], dict[int, str]()
        week_s = table.gps_week * float(WEEK_S)
        if prepared.t_s.size and np.isfinite(prepared.t_s[0]):
            self._forget_before(float(prepared.t_s[0]) + week_s)
        first = prepared.first_row.tolist()
        for k, t_s in enumerate(prepared.t_s.tolist() if self._sets else ()):
            seen = prepared.rows[first[k] : first[k + 1]]
            if not np.isfinite(t_s):
                epochs.append("")
                continue
            said = self._correct(seen, t_s, week_s, observations.signals, table, rules, first[k], rows)
            if not said:
                self._take_others(seen, observations, k, t_s + week_s)
            epochs.append(said)
        return Differential(epochs or [""] * (len(first) - 1), rows)

    def _take_others(self, seen: Records, observations: Observations, epoch: int, gps_s: float) -> None:
        """Let the further signals of corrected satellites bear on their corrections."""
        rows = seen[seen["correction_sigma_m"] > 0.0]
        others = self._at(gps_s)[0].others
        measured = signal_differences(observations, epoch, rows)
        known = {name: value_m + others[name] for name, value_m in measured.items() if name in others}
        means = self._signals.take(gps_s, centred(known))
        by_code: dict[int, list[float]] = defaultdict(list)
        for (code, _), value_m in means.items():
            by_code[code].append(value_m)
        for i in np.flatnonzero(seen["correction_sigma_m"] > 0.0).tolist():
            values_m = by_code.get(int(seen["satellite"][i]), [])
            seen["correction_m"][i] += sum(values_m) / (1 + len(values_m))

    def _correct(
        self,
        seen: Records,
        t_s: float,
        week_s: float,
        signals: tuple[str, ...],
        table: EphemerisTable,
        rules: np.void,
        at: int,
        said: dict[int, str],
    ) -> str:
        """Correct one epoch; gives why it is not corrected."""
        sets = self._at(t_s + week_s)
        if not sets:
            return self._why_none(t_s + week_s)
        for one in sets:
            if not one.checked:
                check(one, table, rules)
        fault = sets[0].fault
        sets = [one for one in sets if not one.fault]
        if not sets:
            return f"corrections refused: {fault}"
        usable = np.flatnonzero(seen["rejection"] == _USABLE)
        rows = seen[usable]
        value_m, sigma_m, ages_s, words = _look_up(rows, sets, t_s + week_s, signals, table, week_s)
        air_m = see_from(sets[0].station, rows, t_s, rules)
        given = sigma_m > 0.0
        short = _too_few(lines_enu(sets[0].station, rows)[given], rows["system"][given])
        if short:
            return f"not corrected: {short}"
        chosen = usable[given]
        seen["correction_m"][chosen] = (value_m + air_m)[given]
        seen["correction_sigma_m"][chosen] = sigma_m[given]
        seen["correction_age_s"][chosen] = ages_s[given]
        seen["rejection"][usable[~given]] = _UNCORRECTED
        for i in np.flatnonzero(~given).tolist():
            said[at + int(usable[i])] = f"left out, as others are corrected: {words[i]}"
        return ""


def add_corrections(rows: Records) -> None:
    """Add their corrections to the pseudoranges of `rows` (dtype ROW) in place; 0 where there is none."""
    rows["pseudorange_m"] += rows["correction_m"]


def _look_up(
    rows: Records,
    sets: Sequence[CorrectionSet],
    gps_s: float,
    signals: tuple[str, ...],
    table: EphemerisTable,
    week_s: float,
) -> tuple[Float64s, Float64s, Float64s, list[str]]:
    """Correction, its standard deviation (0 where there is none), its age, and else why there is none, of each row.

    The latest set counts; where it is for another ephemeris, the latest one before it that is for the
    right one.
    """
    value_m, sigma_m, age_s = np.zeros(rows.size), np.zeros(rows.size), np.zeros(rows.size)
    words = [""] * rows.size
    toe_gps_s = table.rows["toe_s"][rows["ephemeris"]] + week_s
    issue = table.rows["issue"][rows["ephemeris"]]
    for i, code in enumerate(rows["satellite"].tolist()):
        signal = signals[int(rows["signal"][i])]
        for one in sets:
            j = int(one.index[code])
            fault = one.refused.get(code, "") or ("no correction" if j < 0 else "")
            if not fault and one.signal[j] != signal:
                fault = f"corrected is {one.signal[j]}, measured {signal}"
            wrong = not fault and (one.issue[j] != issue[i] or one.toe_gps_s[j] != toe_gps_s[i])
            if wrong:
                words[i] = words[i] or f"the correction is for ephemeris {one.issue[j]}, used is {issue[i]}"
                continue
            words[i] = fault
            if not fault:
                age_s[i] = max(gps_s - one.gps_s, 0.0)
                value_m[i] = one.correction_m[j] + one.rate_mps[j] * (gps_s - one.gps_s)
                sigma_m[i] = np.hypot(max(one.sigma_m[j], 1e-3), AGEING_MPS * age_s[i])
            break
    return value_m, sigma_m, age_s, words


def _too_few(lines: Float64s, system: NDArray[np.int64]) -> str:
    """Why satellites in these directions determine no place well enough by themselves; empty when they do."""
    systems, counts = np.unique(system, return_counts=True)
    together = np.isin(system, systems[counts > 1])
    lines, system = lines[together], system[together]
    systems = systems[counts > 1]
    needed = 3 + systems.size + SPARE
    if system.size < needed:
        return f"{system.size} usable corrections, {needed} needed"
    design = np.hstack([lines, (system[:, None] == systems[None, :]).astype(float)])
    normal = design.T @ design
    if np.linalg.cond(normal) > 1e8:  # noqa: PLR2004 - beyond, the inverse below has no meaning
        return "the corrected satellites determine no place"
    pdop = float(np.sqrt(np.trace(np.linalg.inv(normal)[:3, :3])))
    return f"PDOP {pdop:.0f} of the corrected satellites" if pdop > LARGEST_PDOP else ""
