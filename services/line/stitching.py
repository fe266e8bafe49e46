"""Lines of a map put together: pieces that come unordered, reversed and doubled become a line with branches.

Ends within JOIN_M are one joint; an end on another piece divides it there; small gaps are closed.
The longest way that a train can run is the main line. What leaves it and ends elsewhere is a branch;
what runs beside it is a parallel track. Everything that is left out or guessed is said in the notes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.line.track_graph import Piece, Step, TrackGraph, path_of

Floats = NDArray[np.float64]

JOIN_M: Final = 5.0
GAP_M: Final = 60.0
"""Gaps up to this between ends that lead nowhere else are closed by a straight."""
BESIDE_M: Final = 15.0
"""Tracks that stay this near are parallel."""
BESIDE_SHARE: Final = 0.8
SAMPLE_M: Final = 25.0
SHORTEST_BRANCH_M: Final = 300.0
"""Shorter spurs are sidings or the ends of platforms."""
MOST_PIECES: Final = 20_000


class StitchingError(ValueError):
    """Pieces that make no line."""


@dataclass(frozen=True, slots=True)
class StitchedBranch:
    """A way that leaves the main line."""

    plane_m: Floats
    """Shape (n, 2), from the junction on."""


@dataclass(frozen=True, slots=True)
class StitchedTrack:
    """A track beside the main line."""

    plane_m: Floats
    """Shape (n, 2)."""


@dataclass(frozen=True, slots=True)
class Stitched:
    """A line put together."""

    main_m: Floats
    """Shape (n, 2)."""
    branches: tuple[StitchedBranch, ...]
    parallel: tuple[StitchedTrack, ...]
    notes: tuple[str, ...]


@dataclass(slots=True)
class _Joints:
    """Joints, each with the place of the end that made it."""

    places: list[Floats] = field(default_factory=list)

    def near(self, place: Floats) -> int:
        """The joint within JOIN_M, a new one if there is none."""
        if self.places:
            distance = np.hypot(*(np.array(self.places) - place).T)
            if float(distance.min()) <= JOIN_M:
                return int(distance.argmin())
        self.places.append(place)
        return len(self.places) - 1


def stitch(lines: Sequence[Floats], *, gap_m: float = GAP_M, reversals: bool = False) -> Stitched:
    """Main line, branches and parallel tracks of lines (n, 2) in a plane; `reversals` lets trains turn round at joints.

    Raises StitchingError when there is nothing, or far too much, to put together.
    """
    if len(lines) > MOST_PIECES:
        msg = f"{len(lines)} lines are those of a whole country: select one line"
        raise StitchingError(msg)
    notes: list[str] = []
    graph = TrackGraph(_pieces(_different(lines)), reversals)
    if not graph.pieces:
        msg = "no line with a length"
        raise StitchingError(msg)
    beside = _set_apart(graph)
    _close_gaps(graph, beside, gap_m, notes)
    groups = [group for group in graph.groups() if not set(group) & beside]
    for group in groups[1:]:
        long_m = sum(graph.pieces[k].length_m for k in group)
        notes.append(
            f"{long_m:.0f} m of track hang together with nothing and are left out: ends more than {gap_m:g} m away"
        )
    way = graph.longest_way(groups[0])
    main = path_of(graph, way)
    branches, parallel = _rest(graph, groups[0], way, main, notes)
    parallel += [StitchedTrack(graph.pieces[k].plane_m) for k in sorted(beside)]
    return Stitched(main, tuple(branches), tuple(parallel), tuple(notes))


def _different(lines: Sequence[Floats]) -> list[Floats]:
    """Lines with a length, each once, whichever way round."""
    seen: set[bytes] = set()
    kept: list[Floats] = []
    for line in lines:
        moved = np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > 1e-3])  # noqa: PLR2004 - a millimetre
        plane = np.ascontiguousarray(line[moved])
        rounded = plane.round(2)
        keys = {rounded.tobytes(), np.ascontiguousarray(rounded[::-1]).tobytes()}
        if len(plane) > 1 and not keys & seen:
            seen |= keys
            kept.append(plane)
    return kept


def _pieces(lines: Sequence[Floats]) -> list[Piece]:
    """Lines divided where another one ends on them, with their joints."""
    joints = _Joints()
    ends = [(joints.near(line[0]), joints.near(line[-1])) for line in lines]
    places = np.array(joints.places).reshape(-1, 2)
    pieces: list[Piece] = []
    for line, (first, last) in zip(lines, ends, strict=True):
        cuts = _cuts(line, places, {first, last})
        start, joint = 0, first
        for vertex, other in cuts:
            pieces.append(Piece(line[start : vertex + 1], joint, other))
            start, joint = vertex, other
        pieces.append(Piece(line[start:], joint, last))
    return [one for one in pieces if len(one.plane_m) > 1 and (one.first != one.last or one.length_m > BESIDE_M)]


def _cuts(line: Floats, places: Floats, own: set[int]) -> list[tuple[int, int]]:
    """Inner vertices (in order) at which other lines end, with the joint there."""
    found: list[tuple[int, int]] = []
    low, high = line.min(axis=0) - JOIN_M, line.max(axis=0) + JOIN_M
    for joint in np.flatnonzero(((places >= low) & (places <= high)).all(axis=1)).tolist():
        if joint in own or len(line) <= 2:  # noqa: PLR2004 - no inner vertices
            continue
        distance = np.hypot(*(line[1:-1] - places[joint]).T)
        if float(distance.min()) <= JOIN_M:
            found.append((int(distance.argmin()) + 1, joint))
    found.sort()
    return [one for k, one in enumerate(found) if k == 0 or one[0] != found[k - 1][0]]


def _set_apart(graph: TrackGraph) -> set[int]:
    """Pieces of the groups that run beside a longer one: the other track of a double line."""
    groups = graph.groups()
    apart: set[int] = set()
    for number, group in enumerate(groups[1:], 1):
        longer = [graph.pieces[k].plane_m for other in groups[:number] for k in other if k not in apart]
        own = np.concatenate([_sampled(graph.pieces[k].plane_m) for k in group])
        if float((_distance_to(own, longer) <= BESIDE_M).mean()) >= BESIDE_SHARE:
            apart |= set(group)
    return apart


def _close_gaps(graph: TrackGraph, beside: set[int], gap_m: float, notes: list[str]) -> None:
    """Straights between the nearest loose ends of different groups, until none are near enough."""
    while True:
        groups = [group for group in graph.groups() if not set(group) & beside]
        ends = [(joint, number, place) for number, group in enumerate(groups) for joint, place in _loose(graph, group)]
        best: tuple[float, int, int, Floats, Floats] | None = None
        for i, (joint, number, place) in enumerate(ends):
            for other, another, there in ends[i + 1 :]:
                distance = float(np.hypot(*(there - place)))
                if number != another and distance <= gap_m and (best is None or distance < best[0]):
                    best = (distance, joint, other, place, there)
        if best is None:
            return
        notes.append(f"a gap of {best[0]:.0f} m was closed by a straight")
        graph.pieces.append(Piece(np.stack([best[3], best[4]]), best[1], best[2]))


def _loose(graph: TrackGraph, group: Sequence[int]) -> list[tuple[int, Floats]]:
    """Joints of a group at which a single piece ends, with their places."""
    ends: dict[int, list[Floats]] = {}
    for number in group:
        piece = graph.pieces[number]
        ends.setdefault(piece.first, []).append(piece.plane_m[0])
        ends.setdefault(piece.last, []).append(piece.plane_m[-1])
    return [(joint, places[0]) for joint, places in sorted(ends.items()) if len(places) == 1]


def _rest(
    graph: TrackGraph, group: Sequence[int], way: Sequence[Step], main: Floats, notes: list[str]
) -> tuple[list[StitchedBranch], list[StitchedTrack]]:
    """What hangs on the main line: branches, tracks beside it, and notes about the rest."""
    left = set(group) - {step[0] for step in way}
    on_main = [graph.end_of((way[0][0], not way[0][1])), *(graph.end_of(step) for step in way)]
    branches: list[StitchedBranch] = []
    parallel: list[StitchedTrack] = []
    for number in sorted(left):
        piece = graph.pieces[number]
        if float((_distance_to(_sampled(piece.plane_m), [main]) <= BESIDE_M).mean()) >= BESIDE_SHARE:
            parallel.append(StitchedTrack(piece.plane_m))
            left.discard(number)
    for joint in on_main:
        while True:
            spur, long_m = graph.farthest(joint, left)
            if not spur or long_m < SHORTEST_BRANCH_M or graph.end_of(spur[-1]) in on_main:
                break
            branches.append(StitchedBranch(path_of(graph, spur)))
            left -= {step[0] for step in spur}
    unused_m = sum(graph.pieces[k].length_m for k in left)
    if unused_m > BESIDE_M:
        notes.append(
            f"{unused_m:.0f} m of track in {len(left)} pieces are neither main line nor branch and are left out"
        )
    return branches, parallel


def _sampled(plane_m: Floats) -> Floats:
    """Points every SAMPLE_M along a line."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(plane_m, axis=0).T))])
    wanted = np.linspace(0.0, length[-1], max(int(length[-1] / SAMPLE_M), 1) + 1)
    return np.stack([np.interp(wanted, length, plane_m[:, k]) for k in range(2)], axis=1)


def _distance_to(points: Floats, lines: Sequence[Floats]) -> Floats:
    """Distance (n,) of points to the nearest of some lines."""
    nearest = np.full(len(points), np.inf)
    for line in lines:
        start, step = line[:-1], np.diff(line, axis=0)
        offset = points[:, None, :] - start
        share = np.clip((offset * step).sum(axis=2) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
        gap = offset - share[..., None] * step
        nearest = np.minimum(nearest, np.sqrt((gap**2).sum(axis=2).min(axis=1)))
    return nearest
