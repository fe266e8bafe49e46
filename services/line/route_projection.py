"""A run's places projected onto a line with its branches: every passage that explains them, with its probability.

Each way onto which a place could fall is followed by itself, within a window around its place before, so a
line that nears itself is not confused with itself. A way gains or loses probability with the distance
of the places from it. After a gap, or when nothing fits any longer, all passages near enough are
candidates anew. Before a junction all branches are one place; behind it they are told apart only once
the places do. Tracks side by side are never told apart by places: satellites err by more than their distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from services.line.alignment import Alignment
from services.line.projection import foot_within
from services.numerics.kernel import inner_kernel, kernel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_WAYS: Final = 24
GATE_M: Final = 150.0
"""Passages further from a place than this do not explain it."""
REACH_M: Final = 40.0
"""Places are looked for this far along the line, and as far as a train gets besides."""
FASTEST_MPS: Final = 100.0
LONGEST_GAP_S: Final = 60.0
"""After this long without a place all passages are candidates anew."""
SHORT_GAP_S: Final = 5.0
"""After this long a train may have come to another passage of the line: all that it can have reached are candidates."""
MOST_MISSED: Final = 5
"""So many places in a row beyond GATE_M of every way: all passages are candidates anew."""
SAME_M: Final = 60.0
"""Ways nearer to each other along one route than this are one."""
SEED_APART_M: Final = 100.0
EDGE_M: Final = 0.5
CORRELATION: Final = 10.0
"""Errors of successive places are alike; so many of them count as one."""
CLIPPED: Final = 25.0
"""Largest squared distance over its standard deviation that counts: one wild place proves nothing."""
GIVEN_UP: Final = 20.0
"""A way this many nats less probable than the best is given up."""


@dataclass(frozen=True, slots=True)
class RunProjection:
    """Where the places of a run fall. All arrays have shape (n,)."""

    axis_m: Floats
    """Of the most probable way; NaN where none is near."""
    aside_m: Floats
    """Distance from the axis, positive to the left."""
    route: Ints
    """Number of the branch's alignment among those given, where the place is on a branch; that of the main line
    (the one without a junction) elsewhere; -1 where there is none."""
    probability: Floats
    """Of this place and route against all others that explain the run so far."""
    seeded: NDArray[np.bool_]
    """Where candidates were looked for anew: at the start, after a gap, after nothing fitted."""
    tracks: Ints
    """How many tracks lie side by side here; more than 1: the track is undecided."""


def project_run(
    ways: Sequence[Alignment], t_s: ArrayLike, lat_deg: ArrayLike, lon_deg: ArrayLike, sigma_m: ArrayLike = 5.0
) -> RunProjection:
    """Project places, in order of time, onto alignments of one line (the main line and its branches).

    `t_s`, `lat_deg`, `lon_deg` have shape (n,); `sigma_m`, the error across, one value or (n,).
    Places that are NaN have no foot. Raises ValueError for alignments of different lines, and none.
    """
    if not ways or len({one.axis.reference_deg for one in ways}) != 1:
        msg = "alignments of one line are wanted"
        raise ValueError(msg)
    lat, lon = np.asarray(lat_deg, float), np.asarray(lon_deg, float)
    known = np.isfinite(lat) & np.isfinite(lon)
    height = float(ways[0].position(0.0)[2])
    places = np.full((len(lat), 2), np.nan)
    places[known] = ways[0].axis.to_plane(lat[known], lon[known], np.full(int(known.sum()), height))
    sigma = np.array(np.broadcast_to(np.asarray(sigma_m, float), lat.shape))
    first = np.cumsum([0, *(len(one.axis.axis_m) for one in ways)])
    junction = np.array([np.inf if one.junction_axis_m is None else one.junction_axis_m for one in ways])
    found = np.full((len(lat), 5), np.nan)
    _follow_ways(
        np.concatenate([one.axis.axis_m for one in ways]),
        np.concatenate([one.axis.plane_m for one in ways]),
        first,
        junction,
        places,
        np.array(t_s, float),
        np.maximum(sigma, 0.5),
        found,
    )
    route = np.where(np.isfinite(found[:, 2]), found[:, 2], -1.0).astype(np.int64)
    tracks = np.ones(len(lat), np.int64)
    for k, one in enumerate(ways):
        here = route == k
        tracks[here] = tracks_beside(one, found[here, 0])
    return RunProjection(found[:, 0], found[:, 1], route, found[:, 3], found[:, 4] == 1.0, tracks)


def tracks_beside(alignment: Alignment, axis_m: ArrayLike) -> Ints:
    """How many tracks lie side by side at places: 1, and one more for each parallel track there."""
    places = np.asarray(axis_m, float)
    count = np.ones(places.shape, np.int64)
    for one in alignment.parallel_tracks:
        count += (places >= one.start_axis_m) & (places <= one.end_axis_m)
    return count


@inner_kernel
def _seed(
    axis_m: Floats, plane_m: Floats, first: Ints, place: Floats, route: Ints, at_m: Floats, aside_m: Floats
) -> int:
    """Fill in every passage within GATE_M of a place, nearest point of each; gives their number."""
    count = 0
    for r in range(first.size - 1):
        for i in range(first[r], first[r + 1] - 1):
            along, aside = foot_within(axis_m, plane_m, place[0], place[1], i, i + 1)
            if abs(aside) > GATE_M:
                continue
            same = -1
            for k in range(count):
                if route[k] == r and abs(at_m[k] - along) < SEED_APART_M:
                    same = k
            if same < 0 and count < route.size:
                same = count
                count += 1
                aside_m[same] = np.inf
            if same >= 0 and abs(aside) < abs(aside_m[same]):
                route[same], at_m[same], aside_m[same] = r, along, aside
    kept = 0
    for k in range(count):
        low, high = first[route[k]], first[route[k] + 1]
        own = axis_m[low:high]
        start = low + max(np.searchsorted(own, at_m[k] - REACH_M) - 1, 0)
        end = min(low + np.searchsorted(own, at_m[k] + REACH_M), high - 1)
        _, nearest = foot_within(axis_m, plane_m, place[0], place[1], start, end)
        # Where the line is nearer a little further on, this is the edge of another passage and none of its own.
        if abs(nearest) > abs(aside_m[k]) - EDGE_M:
            route[kept], at_m[kept], aside_m[kept] = route[k], at_m[k], aside_m[k]
            kept += 1
    return kept


@inner_kernel
def _spawn(junction: Floats, route: Ints, at_m: Floats, aside_m: Floats, weight: Floats, count: int) -> int:
    """Add the routes that go on from the same place as the most probable way; gives the number of ways."""
    best = 0
    for k in range(count):
        if weight[k] > weight[best]:
            best = k
    for r in range(junction.size):
        if count >= route.size or at_m[best] > min(junction[r], junction[route[best]]):
            continue
        there = False
        for k in range(count):
            if route[k] == r and abs(at_m[k] - at_m[best]) < SAME_M:
                there = True
        if not there:
            route[count], at_m[count], aside_m[count], weight[count] = r, at_m[best], aside_m[best], weight[best]
            count += 1
    return count


@inner_kernel
def _reached(
    axis_m: Floats,
    plane_m: Floats,
    first: Ints,
    place: Floats,
    reach_m: float,
    route: Ints,
    at_m: Floats,
    aside_m: Floats,
    weight: Floats,
    count: int,
) -> int:
    """All passages near a place that a way before can have reached, each as probable as the best of these.

    Gives the number of ways; 0, and all as it was, where there is none.
    """
    new_route, new_at_m, new_aside_m = np.zeros_like(route), np.zeros_like(at_m), np.zeros_like(aside_m)
    near = _seed(axis_m, plane_m, first, place, new_route, new_at_m, new_aside_m)
    new_weight = np.full(near, -np.inf)
    for j in range(near):
        for k in range(count):
            if route[k] == new_route[j] and abs(at_m[k] - new_at_m[j]) <= reach_m:
                new_weight[j] = max(new_weight[j], weight[k])
    kept = 0
    for j in range(near):
        if new_weight[j] > -np.inf:
            route[kept], at_m[kept], aside_m[kept] = new_route[j], new_at_m[j], new_aside_m[j]
            weight[kept] = new_weight[j]
            kept += 1
    return kept


@inner_kernel
def _kept(route: Ints, at_m: Floats, aside_m: Floats, weight: Floats, count: int) -> int:
    """Drop ways that are given up or have run together; weights are then relative to the best. Gives their number."""
    top = weight[:count].max()
    kept = 0
    for k in range(count):
        keep = weight[k] - top > -GIVEN_UP
        for j in range(kept):
            if keep and route[j] == route[k] and abs(at_m[j] - at_m[k]) < SAME_M:
                keep = False
                if weight[k] - top > weight[j]:
                    at_m[j], aside_m[j], weight[j] = at_m[k], aside_m[k], weight[k] - top
        if keep:
            route[kept], at_m[kept], aside_m[kept], weight[kept] = route[k], at_m[k], aside_m[k], weight[k] - top
            kept += 1
    return kept


@inner_kernel
def _is_counted(junction: Floats, route: Ints, at_m: Floats, way: int) -> bool:
    """Whether an earlier way is at the same place: routes are one before their junction, and count once."""
    for j in range(way):
        before = at_m[way] <= min(junction[route[j]], junction[route[way]])
        if before and abs(at_m[j] - at_m[way]) < SAME_M:
            return True
    return False


@inner_kernel
def _report(
    junction: Floats, route: Ints, at_m: Floats, aside_m: Floats, weight: Floats, count: int, row: Floats
) -> None:
    """The most probable way, and the share of all ways that are at the same place."""
    best = 0
    for k in range(count):
        if weight[k] > weight[best] or (weight[k] == weight[best] and junction[route[k]] > junction[route[best]]):
            best = k
    shared, total = 0.0, 0.0
    for k in range(count):
        share = np.exp(weight[k] - weight[best])
        near = abs(at_m[k] - at_m[best]) < SAME_M
        one_place = route[k] == route[best] or at_m[best] <= min(junction[route[k]], junction[route[best]])
        if not _is_counted(junction, route, at_m, k):
            total += share
            if near and one_place:
                shared += share
    place_route = route[best]
    if at_m[best] <= junction[place_route]:
        for r in range(junction.size):
            if junction[r] > junction[place_route]:
                place_route = r
    row[0], row[1], row[2], row[3] = at_m[best], aside_m[best], place_route, min(shared / total, 1.0)


@kernel
def _follow_ways(
    axis_m: Floats,
    plane_m: Floats,
    first: Ints,
    junction: Floats,
    places: Floats,
    t_s: Floats,
    sigma_m: Floats,
    found: Floats,
) -> None:
    """Rows of axis_m, aside_m, route, probability, seeded for places one after the other."""
    route, at_m = np.zeros(MOST_WAYS, np.int64), np.zeros(MOST_WAYS)
    aside_m, weight = np.zeros(MOST_WAYS), np.zeros(MOST_WAYS)
    count, missed, last_s = 0, 0, -np.inf
    for i in range(places.shape[0]):
        if not (np.isfinite(places[i, 0]) and np.isfinite(t_s[i])):
            continue
        gap_s = max(t_s[i] - last_s, 0.0)
        found[i, 4] = 0.0
        if count == 0 or gap_s > LONGEST_GAP_S or missed >= MOST_MISSED:
            count = _seed(axis_m, plane_m, first, places[i], route, at_m, aside_m)
            weight[:] = 0.0
            found[i, 4], missed = 1.0, 0
        else:
            count = _spawn(junction, route, at_m, aside_m, weight, count)
            reach_m = REACH_M + FASTEST_MPS * gap_s
            reached = 0
            if gap_s > SHORT_GAP_S:
                reached = _reached(axis_m, plane_m, first, places[i], reach_m, route, at_m, aside_m, weight, count)
            count = reached if reached > 0 else count
            for k in range(count if reached == 0 else 0):
                low, high = first[route[k]], first[route[k] + 1]
                own = axis_m[low:high]
                start = low + max(np.searchsorted(own, at_m[k] - reach_m) - 1, 0)
                end = low + min(np.searchsorted(own, at_m[k] + reach_m), own.size - 1)
                start = min(start, high - 2)
                at_m[k], aside_m[k] = foot_within(
                    axis_m, plane_m, places[i, 0], places[i, 1], start, max(end, start + 1)
                )
        if count == 0:
            continue
        for k in range(count):
            weight[k] -= 0.5 * min((aside_m[k] / sigma_m[i]) ** 2, CLIPPED) / CORRELATION
        count = _kept(route, at_m, aside_m, weight, count)
        _report(junction, route, at_m, aside_m, weight, count, found[i])
        missed = missed + 1 if abs(found[i, 1]) > GATE_M else 0
        if missed > 0:
            found[i, :4] = np.nan
        last_s = t_s[i]
