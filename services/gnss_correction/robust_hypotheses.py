"""Whether a single satellite leads the robust filter astray: a filter without it runs beside, for each that could.

A strong satellite whose pseudorange is off from the first epoch on draws a filter with it as long as the others
are weak, and then looks better than they do. Only who has never listened to it can tell (solution
separation, as in Brown and McBurney 1988 and in advanced RAIM, Blanch et al. 2015). Hence for each of the MOST
satellites that weigh most there is a filter of its own that leaves it out, from the same first epoch on, and the
following holds:

Evidence. All filters are measured by all pseudoranges, those left out too, with one cost: that of Student's t,
bounded because a satellite may be faulty whatever the figure. Errors last, for seconds or for metres of way:
of the mean cost over the last WINDOW independent epochs the difference, times how many there were, is the
logarithm of the odds between two filters (as the line filter reckons).

Bound. As long as the odds against a filter are not overwhelming, the bound reaches as far as it: the distance between
both places and its own bound, which counts up to that of the filter followed. What was covered once is let go slowly.
A filter that has too few satellites left to determine a place by itself cannot testify.

Exclusion. When the odds for a filter become overwhelming, it is the one followed, and its satellite is
left out. The one followed so far stays a hypothesis, so that this can be undone; and as the others now leave out that
satellite and one more each, several faults are found one after the other. A satellite that agreed for
CLEAN_S with a place found without it is taken back.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from services.gnss_correction.ephemeris_table import CODES
from services.gnss_correction.rejection import Rejection
from services.gnss_correction.robust_bound import bound_m
from services.gnss_correction.robust_doubt import covered_m
from services.gnss_correction.robust_epoch import measure
from services.gnss_correction.robust_state import SIZE, VELOCITY, Memory, memory_of, no_memories
from services.gnss_correction.solver_arrays import ROW, Float64s, Ints, Records
from services.numerics.kernel import inner_kernel

MOST: Final = 8
"""Satellites that are left out in turn: those that weigh most."""
WINDOW: Final = 10.0
"""Independent epochs over which costs are averaged."""
LASTING_S: Final = 8.0
LASTING_M: Final = 10.0
"""Errors of pseudoranges last for so long, or for so much of way (as in the line filter)."""
SHORTEST_S: Final = 0.02
IMPLAUSIBLE: Final = 10.0
OVERWHELMING: Final = 30.0
"""Logarithm of the odds, beyond which a filter is not covered, or another one is followed. It takes more than e³⁰,
because the errors of several satellites in one street are not independent of each other."""
SURE_S: Final = 1.0
HELD_S: Final = 30.0
"""What the bound had to cover is let go with this time constant: reflections come back."""
INFLUENCE_S: Final = 10.0
REPLACED: Final = 1.5
NEGLIGIBLE: Final = 0.01
"""A satellite takes the place of another when its share in the weight is larger by this factor and this share."""
FREE_M: Final = 500.0
"""Freedom of a filter at the start, whose first solution was found with the satellite that it leaves out."""
FORGIVEN: Final = 30.0
"""Later, how many of its standard deviations a satellite may have been late before it was left out."""
CLEAN_S: Final = 10.0
CLEAN_SQUARE: Final = 9.0
MOST_EXCLUDED: Final = 3

_USABLE, _INCONSISTENT = int(Rejection.USABLE), int(Rejection.INCONSISTENT)


class Bank(NamedTuple):
    """The filters beside the one that is followed."""

    filters: Memory
    """MOST filters, and room for one, as of `no_memories`."""
    satellite: Ints
    """Shape (MOST,): code of the satellite in which each differs from the filter followed, -1 where it is idle."""
    better_s: Float64s
    """Shape (MOST,): for how long the odds for it have been overwhelming."""
    influence: Float64s
    """Shape (CODES,): mean share of each satellite in the weight of all."""
    clean_s: Float64s
    """Shape (CODES,): for how long a satellite left out has agreed."""
    held_m: Float64s
    """Shape (1,): by how much the bound exceeds that of the filter followed."""
    rows: Records
    """Rows of an epoch, as one of the filters sees them."""


def no_bank() -> Bank:
    """Filters that are all idle."""
    return Bank(
        no_memories(MOST + 1),
        np.full(MOST, -1, np.int64),
        np.zeros(MOST),
        np.zeros(CODES),
        np.zeros(CODES),
        np.zeros(1),
        np.zeros(CODES, ROW),
    )


@inner_kernel
def _copy(source: Memory, target: Memory) -> None:
    target.now[0] = source.now[0]
    target.state[:] = source.state
    target.covariance[:, :] = source.covariance
    target.clock_known[:] = source.clock_known
    target.excluded[:] = source.excluded
    target.level[:, :] = source.level
    for code in range(CODES):
        if source.responding[code] + target.responding[code] > 0:
            target.response[code] = source.response[code]
        target.responding[code] = source.responding[code]


@inner_kernel
def _filter_of(bank: Bank, code: int) -> int:
    """Which filter differs in a satellite; -1 for none."""
    for i in range(MOST):
        if bank.satellite[i] == code:
            return i
    return -1


@inner_kernel
def begin(rows: Records, memory: Memory, bank: Bank) -> None:
    """At a start of the filter followed, before its first epoch: leave out the strongest satellites in turn."""
    bank.satellite[:] = -1
    bank.influence[:] = 0.0
    bank.held_m[0] = 0.0
    for i in range(MOST):
        strongest, most_dbhz = -1, -np.inf
        for row in rows:
            strength_dbhz = row.strength_dbhz if np.isfinite(row.strength_dbhz) else 0.0
            if row.rejection == _USABLE and strength_dbhz > most_dbhz and _filter_of(bank, row.satellite) < 0:
                strongest, most_dbhz = row.satellite, strength_dbhz
        if strongest < 0:
            return
        one = memory_of(bank.filters, i)
        _copy(memory, one)
        bank.satellite[i], bank.better_s[i] = strongest, 0.0
        one.excluded[strongest] = 1
        for axis in range(3):
            one.covariance[axis, axis] += FREE_M * FREE_M


@inner_kernel
def _spawn(memory: Memory, bank: Bank, i: int, code: int) -> None:
    """Let filter `i` differ from the one followed in a satellite, and forget what that one has said."""
    one = memory_of(bank.filters, i)
    _copy(memory, one)
    bank.satellite[i], bank.better_s[i] = code, 0.0
    one.excluded[code] = 1 - one.excluded[code]
    if one.responding[code] == 1:
        response = one.response[code]
        for p in range(SIZE):
            for q in range(SIZE):
                one.covariance[p, q] += FORGIVEN * FORGIVEN * response[p] * response[q]
        response[:] = 0.0
        one.responding[code] = 0


@inner_kernel
def _news(memory: Memory, dt_s: float) -> float:
    """How much of an epoch is independent of the one before."""
    square = 0.0
    for i in range(3):
        square += memory.state[VELOCITY + i] * memory.state[VELOCITY + i]
    return float(min(max(dt_s, SHORTEST_S) * (1.0 / LASTING_S + np.sqrt(square) / LASTING_M), 1.0))


@inner_kernel
def _average(memory: Memory, news: float) -> None:
    """Take the cost of the last epoch into the mean."""
    now = memory.now[0]
    share = 1.0 - np.exp(-news / WINDOW)
    now.cost_weight = now.cost_weight * (1.0 - share) + share
    now.mean_cost += share / now.cost_weight * (now.cost - now.mean_cost)


@inner_kernel
def leave_out(rows: Records, memory: Memory) -> None:
    """Mark the rows that a filter leaves out."""
    for row in rows:
        if row.rejection == _USABLE and memory.excluded[row.satellite] == 1:
            row.rejection = _INCONSISTENT


@inner_kernel
def follow(rows: Records, memory: Memory, bank: Bank, dt_s: float, rules: Any, ours: Any) -> None:  # noqa: ANN401 - numba records
    """Take an epoch into the filters beside, before the one followed (`memory`) does; `rows` stay as they are."""
    seen = bank.rows[: rows.size]
    news = _news(memory, dt_s)
    for i in range(MOST):
        if bank.satellite[i] < 0:
            continue
        one = memory_of(bank.filters, i)
        for k in range(rows.size):
            seen[k] = rows[k]
        one.now[0].t_s, one.now[0].common_m = memory.now[0].t_s, memory.now[0].common_m
        leave_out(seen, one)
        if measure(seen, one, dt_s, rules, ours)[0] > 0:
            _average(one, news)


@inner_kernel
def _odds(memory: Memory, one: Memory) -> float:
    """Logarithm of the odds for a filter against the one followed."""
    now = memory.now[0]
    return float((now.mean_cost - one.now[0].mean_cost) * max(now.cost_weight * WINDOW, 1.0))


@inner_kernel
def _determined(memory: Memory) -> bool:
    """Whether the satellites of the last epoch alone determine the place of a filter."""
    return bool(memory.now[0].determined_s == memory.now[0].t_s)


@inner_kernel
def _switch(memory: Memory, bank: Bank, dt_s: float) -> None:
    """Follow another filter when the odds for it have been overwhelming for long enough."""
    best, most = -1, OVERWHELMING
    for i in range(MOST):
        if bank.satellite[i] < 0:
            continue
        odds = _odds(memory, memory_of(bank.filters, i))
        sure = odds > OVERWHELMING and _determined(memory_of(bank.filters, i))
        bank.better_s[i] = bank.better_s[i] + dt_s if sure else 0.0
        if sure and bank.better_s[i] >= SURE_S and odds > most:
            best, most = i, odds
    if best < 0 or np.sum(memory_of(bank.filters, best).excluded) > MOST_EXCLUDED:
        return
    one, room = memory_of(bank.filters, best), memory_of(bank.filters, MOST)
    _copy(memory, room)
    _copy(one, memory)
    _copy(room, one)
    bank.clean_s[bank.satellite[best]] = 0.0
    for i in range(MOST):
        bank.better_s[i] = 0.0
        if i != best:
            bank.satellite[i] = -1


@inner_kernel
def _readmit(rows: Records, memory: Memory, bank: Bank, dt_s: float) -> None:
    """Take satellites back that agree with the place found without them."""
    for row in rows:
        code = row.satellite
        if memory.excluded[code] == 0 or row.rejection != _INCONSISTENT:
            continue
        agrees = row.residual_m * row.residual_m < CLEAN_SQUARE * row.variance_m2
        bank.clean_s[code] = bank.clean_s[code] + dt_s if agrees else 0.0
        if bank.clean_s[code] > CLEAN_S:
            memory.excluded[code] = 0
            i = _filter_of(bank, code)
            if i >= 0:
                bank.satellite[i] = -1


@inner_kernel
def _weigh(rows: Records, memory: Memory, bank: Bank, dt_s: float) -> None:
    """Take in how much each satellite weighs."""
    share = 1.0 - np.exp(-max(dt_s, SHORTEST_S) / INFLUENCE_S)
    whole = 1e-12
    for k in range(rows.size):
        whole += memory.weight[k] if rows[k].rejection == _USABLE else 0.0
    for code in range(CODES):
        bank.influence[code] *= 1.0 - share
    for k in range(rows.size):
        if rows[k].rejection == _USABLE:
            bank.influence[rows[k].satellite] += share * memory.weight[k] / whole


@inner_kernel
def _standing(memory: Memory, bank: Bank, code: int) -> float:
    """How much a satellite deserves a filter: those left out most of all."""
    return float(bank.influence[code] + memory.excluded[code]) if code >= 0 else -1.0


@inner_kernel
def _assign(rows: Records, memory: Memory, bank: Bank) -> None:
    """Give idle filters, and those of satellites that hardly weigh any more, to the satellites that weigh most."""
    for _ in range(MOST):
        best, most = -1, 0.0
        for row in rows:
            standing = _standing(memory, bank, row.satellite)
            seen = row.rejection in (_USABLE, _INCONSISTENT)
            if seen and standing > most and _filter_of(bank, row.satellite) < 0:
                best, most = row.satellite, standing
        worst, least = 0, np.inf
        for i in range(MOST):
            standing = _standing(memory, bank, bank.satellite[i])
            if standing < least:
                worst, least = i, standing
        if best < 0 or (least >= 0.0 and most < REPLACED * least + NEGLIGIBLE):
            return
        _spawn(memory, bank, worst, best)


@inner_kernel
def settle(rows: Records, memory: Memory, bank: Bank, dt_s: float) -> None:
    """After the filter followed took an epoch in: which one is followed, and which satellites are left out in turn."""
    _average(memory, _news(memory, dt_s))
    _weigh(rows, memory, bank, dt_s)
    _readmit(rows, memory, bank, dt_s)
    _switch(memory, bank, dt_s)
    _assign(rows, memory, bank)


@inner_kernel
def separation_m(one: Memory, other: Memory) -> float:
    """Horizontal distance between the places of two filters."""
    square_m2 = 0.0
    for axis in range(2):
        apart_m = 0.0
        for i in range(3):
            apart_m += one.level[axis, i] * (one.state[i] - other.state[i])
        square_m2 += apart_m * apart_m
    return float(np.sqrt(square_m2))


@inner_kernel
def covering_m(memory: Memory, bank: Bank, ours: Any, own_m: float, dt_s: float) -> float:  # noqa: ANN401 - numba record
    """Bound that covers all filters that are not implausible; `own_m` is that of the filter followed."""
    held_m = bank.held_m[0] * np.exp(-dt_s / HELD_S)
    for i in range(MOST):
        if bank.satellite[i] < 0 or _odds(memory, memory_of(bank.filters, i)) < -IMPLAUSIBLE:
            continue
        one, theirs_m = memory_of(bank.filters, i), 0.0
        if _determined(one):
            theirs_m = min(bound_m(one, ours, covered_m(one)), own_m)
        held_m = max(held_m, separation_m(memory, one) + theirs_m - own_m)
    bank.held_m[0] = held_m
    return float(own_m + held_m)
