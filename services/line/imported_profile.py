"""Heights, gradients and speed limits along an imported line, from a table of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from schemas.line import Gradient, SpeedLimit
from services.line.chainage import Chainage
from services.line.gradient_fitting import HEIGHT_TOLERANCE_M, gradients_of, simplified

Floats = NDArray[np.float64]

FEWEST_ROWS: Final = 2


@dataclass(frozen=True, slots=True)
class ProfileAlong:
    """Rows in rising order of place; each quantity may be missing, as a whole or (NaN) in some rows."""

    place_m: Floats
    """Shape (n,): along the axis, or a kilometrage until `by_axis` has turned it."""
    height_m: Floats | None = None
    gradient_permille: Floats | None = None
    """From each place on."""
    limit_mps: Floats | None = None
    """From each place on; NaN ends the limit."""

    def by_axis(self, chainage: Chainage) -> ProfileAlong:
        """With places along the axis instead of kilometrage; rows that the line's does not have are left out."""
        places = [chainage.places(float(one)) for one in self.place_m]
        known = np.array([bool(found) for found in places], bool)
        return self._picked(known, np.array([found[0] for found in places if found]))

    def turned(self, length_m: float) -> ProfileAlong:
        """As seen from the other end of a line."""
        order = np.arange(len(self.place_m))[::-1]
        turned = self._picked(order, length_m - self.place_m[order])
        gradient, limit = turned.gradient_permille, turned.limit_mps
        return replace(
            turned,
            gradient_permille=None if gradient is None else -np.append(gradient[1:], gradient[-1:]),
            limit_mps=None if limit is None else np.append(limit[1:], limit[-1:]),
        )

    def span_m(self) -> tuple[float, float]:
        """Where its rows begin and end."""
        return (float(self.place_m.min()), float(self.place_m.max())) if len(self.place_m) else (np.inf, -np.inf)

    def gradients(self, length_m: float) -> tuple[Gradient, ...]:
        """Gradients of a line of this length as stated, or those of the heights, level where none are known."""
        if self.gradient_permille is not None:
            known = np.isfinite(self.gradient_permille)
            places, values = self.place_m[known], self.gradient_permille[known]
            fresh = np.concatenate([[True], np.diff(values) != 0.0])[: len(values)]
            return tuple(
                Gradient(axis_m=max(round(float(place), 3), 0.0), permille=float(value))
                for place, value in zip(places[fresh], values[fresh], strict=True)
            )
        known_m = self._known_heights()
        if known_m is None:
            return ()
        inside = np.unique(np.clip([0.0, *known_m[0], length_m], 0.0, length_m))
        return gradients_of(inside, np.interp(inside, *known_m))

    def heights_m(self, along_m: Floats) -> Floats:
        """Heights of places: of the straight pieces that `gradients` has; integrated from 0 where none are given."""
        known_m = self._known_heights()
        if known_m is not None:
            places, heights = known_m
            inside = np.unique(np.clip([0.0, *places, along_m[-1]], 0.0, along_m[-1]))
            shown = np.interp(inside, places, heights)
            kept = simplified(inside, shown, HEIGHT_TOLERANCE_M)
            return np.asarray(np.interp(along_m, inside[kept], shown[kept]))
        stated = self.gradients(float(along_m[-1]))
        if not stated:
            return np.zeros(len(along_m))
        starts = np.array([one.axis_m for one in stated])
        slopes = np.array([one.permille for one in stated]) / 1000.0
        at_start = np.concatenate([[0.0], np.cumsum(np.diff(starts) * slopes[:-1])])
        piece = np.clip(np.searchsorted(starts, along_m, side="right") - 1, 0, len(starts) - 1)
        return np.asarray(at_start[piece] + (along_m - starts[piece]) * slopes[piece])

    def speed_limits(self, length_m: float) -> tuple[SpeedLimit, ...]:
        """Limits, each from its row to the next different one."""
        if self.limit_mps is None:
            return ()
        found: list[SpeedLimit] = []
        ends = np.append(self.place_m[1:], length_m)
        for start_m, end_m, limit in zip(self.place_m.tolist(), ends.tolist(), self.limit_mps.tolist(), strict=True):
            first_m, last_m = max(round(start_m, 3), 0.0), min(round(end_m, 3), length_m)
            if not (np.isfinite(limit) and limit > 0.0 and last_m > first_m):
                continue
            if found and found[-1].limit_mps == limit and found[-1].end_axis_m == first_m:
                first_m = found.pop().start_axis_m
            found.append(SpeedLimit(start_axis_m=first_m, end_axis_m=last_m, limit_mps=limit))
        return tuple(found)

    def _picked(self, rows: NDArray[np.bool_] | NDArray[np.int64], place_m: Floats) -> ProfileAlong:
        """Some rows, at these places."""

        def of(column: Floats | None) -> Floats | None:
            return None if column is None else column[rows]

        return ProfileAlong(place_m, of(self.height_m), of(self.gradient_permille), of(self.limit_mps))

    def _known_heights(self) -> tuple[Floats, Floats] | None:
        """Places and heights of the rows that have one, each place once."""
        if self.height_m is None:
            return None
        known = np.isfinite(self.height_m)
        places, first = np.unique(self.place_m[known], return_index=True)
        heights = self.height_m[known][first]
        return (places, heights) if len(places) >= FEWEST_ROWS else None
