"""What a train meets along its way: curvature, slope, roll of the track, allowed speed, metre by metre.

Everything is seen by a train that runs along the table: curvature positive to the left, slope positive
uphill, roll right-handed about the forward axis (positive: right rail low). `reversed_way` gives the same
track to a train that comes from the other end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.simulator.motion_settings import Vehicle

Floats = NDArray[np.float64]
STEP_M: Final = 1.0
GRAVITY_MPS2: Final = 9.80665
COLUMNS: Final = 7
"""Of `felt`: curvature, slope, roll at the sensor's car; slope under the whole train; allowed speed; curvature
and slope at the front end."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackTable:
    """A stretch of track; column i holds at `i * STEP_M` from its start."""

    curvature_per_m: Floats
    slope: Floats
    """Rise over way along the rail (sine of the angle)."""
    roll_rad: Floats
    limit_mps: Floats
    stops_m: Floats
    """Where the front end stops, rising."""

    @property
    def length_m(self) -> float:
        """Length of the stretch."""
        return (len(self.slope) - 1) * STEP_M

    def reversed_way(self) -> TrackTable:
        """The same track for a train that runs the other way."""
        return TrackTable(
            -self.curvature_per_m[::-1],
            -self.slope[::-1],
            -self.roll_rad[::-1],
            self.limit_mps[::-1].copy(),
            (self.length_m - self.stops_m)[::-1].copy(),
        )


def felt_by(track: TrackTable, vehicle: Vehicle, behind_front_m: float, braking_mps2: float) -> Floats:
    """What a vehicle feels with its front end at each place, shape (n, COLUMNS).

    A car body rides on two bogies: it takes the mean over their base, centred `behind_front_m` behind
    the front end. Gravity acts on the whole train. A speed limit holds until the rear end has passed it,
    and is braked down to beforehand with `braking_mps2`.
    """
    base = max(round(vehicle.bogie_base_m / STEP_M), 1)
    train = max(round(vehicle.length_m / STEP_M), 1)
    back = round(behind_front_m / STEP_M)
    body = [_mean(one, back + base // 2, base) for one in (track.curvature_per_m, track.slope, track.roll_rad)]
    limit = np.minimum(_lowest_behind(track.limit_mps, train), vehicle.max_speed_mps)
    way = np.arange(len(limit)) * STEP_M
    energy = limit**2 + 2.0 * braking_mps2 * way
    allowed = np.sqrt(np.maximum(np.minimum.accumulate(energy[::-1])[::-1] - 2.0 * braking_mps2 * way, 0.0))
    under = _mean(track.slope, train, train)
    return np.ascontiguousarray(np.stack([*body, under, allowed, track.curvature_per_m, track.slope], axis=1))


def _mean(values: Floats, back: int, width: int) -> Floats:
    """Mean over the `width` steps that begin `back` steps behind each place; ends go on as they are."""
    pad = abs(back) + width
    sums = np.concatenate([[0.0], np.cumsum(np.pad(values, pad, mode="edge"))])
    first = np.arange(len(values)) + pad - back
    return np.asarray((sums[first + width] - sums[first]) / width)


def _lowest_behind(values: Floats, reach: int) -> Floats:
    """Least value from each place back over `reach` steps."""
    padded = np.concatenate([np.full(reach, np.inf), values])
    windows = np.lib.stride_tricks.sliding_window_view(padded, reach + 1)
    return np.asarray(windows.min(axis=1))


def roughened(track: TrackTable, generator: np.random.Generator, size: float = 1.0) -> TrackTable:
    """The track with the irregularities of maintained rail: level, cross level and alignment.

    Coloured noise of 15 to 60 m wavelength: 0.5 ‰ of slope, 0.8 mrad of roll, 8e-6 1/m of curvature,
    times `size`. It belongs to the track: every train on it feels the same.
    """
    count = len(track.slope)

    def wavy(sigma: float, shortest_m: float, longest_m: float) -> Floats:
        white = generator.standard_normal(count + 400)
        smooth = _mean(white, round(shortest_m / 4), round(shortest_m / 2))
        smooth -= _mean(white, round(longest_m / 4), round(longest_m / 2))
        return np.asarray(size * sigma * smooth[200 : 200 + count] / max(float(smooth.std()), 1e-9))

    return TrackTable(
        track.curvature_per_m + wavy(8e-6, 20.0, 60.0),
        track.slope + wavy(5e-4, 16.0, 60.0),
        track.roll_rad + wavy(8e-4, 12.0, 40.0),
        track.limit_mps,
        track.stops_m,
    )
