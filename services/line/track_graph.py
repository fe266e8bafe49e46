"""Tracks as a graph: pieces joined at their ends, and the longest way through them that a train can run.

A train passes a joint without turning round, so a way goes on only to pieces that lead about straight on;
between the two tracks of a double line it does not double back.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SHARPEST_TURN_RAD: Final = math.radians(75.0)
"""Largest change of direction at a joint: coarse vertices, never a train turning round."""
DIRECTION_M: Final = 15.0
"""Directions at a piece's ends are taken over this length."""
MOST_ENDS: Final = 60
"""Up to so many ends every one is tried as a start; beyond, two sweeps find the longest way of all but odd graphs."""

Step = tuple[int, bool]
"""A piece and whether it is run from its start to its end."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch of track between two joints."""

    plane_m: Floats
    """Shape (n, 2)."""
    first: int
    last: int
    """Joints at its ends."""

    @property
    def length_m(self) -> float:
        """Along the vertices."""
        return float(np.hypot(*np.diff(self.plane_m, axis=0).T).sum())


@dataclass(slots=True)
class TrackGraph:
    """Pieces and joints."""

    pieces: list[Piece] = field(default_factory=list)
    reversals: bool = False
    """Whether a way may turn round at a joint, as in a switchback."""

    def end_of(self, step: Step) -> int:
        """Joint at which a step arrives."""
        piece = self.pieces[step[0]]
        return piece.last if step[1] else piece.first

    def along(self, step: Step) -> Floats:
        """Vertices in the sense of running."""
        plane = self.pieces[step[0]].plane_m
        return plane if step[1] else plane[::-1]

    def groups(self) -> list[list[int]]:
        """Numbers of the pieces that hang together, the longest group first."""
        waiting = set(range(len(self.pieces)))
        at_joint = self._at_joint(waiting)
        found: list[list[int]] = []
        while waiting:
            group, open_pieces = [], [min(waiting)]
            waiting.discard(open_pieces[0])
            while open_pieces:
                number = open_pieces.pop()
                group.append(number)
                for joint in (self.pieces[number].first, self.pieces[number].last):
                    for other in at_joint[joint]:
                        if other in waiting:
                            waiting.discard(other)
                            open_pieces.append(other)
            found.append(sorted(group))
        return sorted(found, key=lambda group: (-sum(self.pieces[k].length_m for k in group), group[0]))

    def longest_way(self, allowed: Iterable[int]) -> list[Step]:
        """The longest of the shortest ways between two ends among some pieces (found by two sweeps)."""
        among = set(allowed)
        at_joint = self._at_joint(among)
        ends = sorted(joint for joint, there in at_joint.items() if len(there) == 1) or sorted(at_joint)[:1]
        best: list[Step] = []
        best_m = -1.0
        for start in ends[:1] if len(ends) > MOST_ENDS else ends:
            way, long_m = self.farthest(start, among)
            if long_m > best_m:
                best, best_m = way, long_m
        if len(ends) > MOST_ENDS:
            best, _ = self.farthest(self.end_of(best[-1]), among)
        return best

    def farthest(self, start: int, allowed: Iterable[int]) -> tuple[list[Step], float]:
        """Shortest way (Dijkstra 1959) from a joint to the one that is farthest, and its length."""
        among = set(allowed)
        at_joint = self._at_joint(among)
        before: dict[Step, Step | None] = {}
        length: dict[Step, float] = {}
        waiting: list[tuple[float, Step, Step]] = []
        for step in self._entered(at_joint, start):
            heapq.heappush(waiting, (self.pieces[step[0]].length_m, step, step))
        reached: dict[int, Step] = {}
        while waiting:
            way_m, step, came = heapq.heappop(waiting)
            if step in length:
                continue
            length[step], before[step] = way_m, None if came == step else came
            joint = self.end_of(step)
            reached.setdefault(joint, step)
            for onto in self._entered(at_joint, joint):
                if onto not in length and onto[0] != step[0] and self._goes_on(step, onto):
                    heapq.heappush(waiting, (way_m + self.pieces[onto[0]].length_m, onto, step))
        if not reached:
            return [], 0.0
        far = max(reached.values(), key=lambda step: (length[step], step))
        way = [far]
        while (earlier := before[way[-1]]) is not None:
            way.append(earlier)
        return way[::-1], length[far]

    def _at_joint(self, among: Iterable[int]) -> dict[int, list[int]]:
        """Pieces at each joint."""
        found: dict[int, list[int]] = {}
        for number in sorted(among):
            for joint in {self.pieces[number].first, self.pieces[number].last}:
                found.setdefault(joint, []).append(number)
        return found

    def _entered(self, at_joint: dict[int, list[int]], joint: int) -> list[Step]:
        """Steps that begin at a joint."""
        there = at_joint.get(joint, ())
        return [(k, True) for k in there if self.pieces[k].first == joint] + [
            (k, False) for k in there if self.pieces[k].last == joint
        ]

    def _goes_on(self, step: Step, onto: Step) -> bool:
        """Whether a train can run from one piece onto another."""
        if self.reversals:
            return True
        arriving, leaving = -_direction(self.along(step)[::-1]), _direction(self.along(onto))
        return bool(arriving @ leaving >= math.cos(SHARPEST_TURN_RAD))


def _direction(plane_m: Floats) -> Floats:
    """Unit vector from the first vertex over about DIRECTION_M."""
    away = plane_m - plane_m[0]
    distance = np.hypot(*away.T)
    far = np.flatnonzero(distance >= DIRECTION_M)
    k = int(far[0]) if len(far) else int(distance.argmax())
    return np.asarray(away[k] / max(float(distance[k]), 1e-9))


def path_of(graph: TrackGraph, way: Sequence[Step]) -> Floats:
    """Vertices (n, 2) of a way, joints once."""
    parts = [graph.along(way[0])[:1], *(graph.along(step)[1:] for step in way)]
    return np.concatenate(parts)
