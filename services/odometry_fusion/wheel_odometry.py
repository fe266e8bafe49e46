"""Odometry by the wheel alone: what most trains have, with a bound that owns up to unseen slips."""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec
import numpy as np
from msgspec import Meta

from services.numerics.kernel import kernel
from services.odometry_fusion.motion_log import (
    DEGRADED,
    PERIOD_S,
    VALID,
    Counts,
    Floats,
    MotionRows,
    SixAxes,
    Vehicle,
)
from services.odometry_fusion.paper_rest import STILL_M
from services.odometry_fusion.paper_smoothing import counts_missing
from services.odometry_fusion.tick_layout import Records
from services.odometry_fusion.ticks import TickMaker

REST_TICKS: Final = 20
REASONS: Final = ("", "no pulses: the last speed is held")

WHEEL_STATE: Final[np.dtype[Any]] = np.dtype([
    ("started", np.int64),
    ("still", np.int64),
    *((name, np.float64) for name in ("way_m", "run_m", "reference_mps", "excess_m", "rest_s")),
])  # fmt: skip
WHEEL_OUT: Final[np.dtype[Any]] = np.dtype([
    ("slip", np.int64),
    ("still", np.int64),
    ("silent", np.int64),
    *((name, np.float64) for name in ("run_m", "excess_m", "provisional_m", "apart_mps", "rest_s")),
])  # fmt: skip


class WheelSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a wheel alone can vouch for."""

    share: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.05
    """Relative error of distance: wear, and slips that nobody sees."""
    unseen_m: Annotated[float, Meta(ge=0.0)] = 30.0
    """What one unseen slip may cost (Iwata et al., section 3.1.4 reckon with 22.8 m after correction)."""
    hardest_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.4
    """No train speeds up or brakes harder in service: a wheel that does slips."""


@kernel
def wheel_ticks(ticks: Records, hardest_mps2: float, pulse_m: float, state: Records, out: Records) -> None:
    """Slip by the wheel's own acceleration: a reference speed follows the wheel at most at the hardest rate.

    What they differ by, over time, adds to the error for good.
    """
    now = state[0]
    for k in range(len(ticks)):
        tick, own = ticks[k], out[k]
        speed_mps = tick.wheel_speed_mps
        if now.started == 0:
            now.started, now.reference_mps, now.way_m = 1, speed_mps, tick.way_m
        moved = abs(tick.way_m - now.way_m) > STILL_M
        silent = counts_missing(tick, pulse_m)
        now.still = 0 if moved or silent else now.still + 1
        now.run_m += abs(tick.way_m - now.way_m)
        now.way_m = tick.way_m
        most_mps = hardest_mps2 * PERIOD_S
        now.reference_mps += min(most_mps, max(-most_mps, speed_mps - now.reference_mps))
        apart_mps = speed_mps - now.reference_mps
        now.excess_m += abs(apart_mps) * PERIOD_S + tick.doubt_m
        own.apart_mps = abs(apart_mps)
        own.slip = (1 if apart_mps > 0.0 else -1) if abs(apart_mps) > 1.0 else 0
        silent_s = tick.tacho_missing_s if silent else 0.0
        own.silent = 1 if silent else 0
        own.provisional_m = 0.5 * hardest_mps2 * silent_s * silent_s
        own.run_m, own.excess_m = now.run_m, now.excess_m
        own.still = 1 if now.still >= REST_TICKS else 0
        now.rest_s = 0.0 if own.still else now.rest_s + PERIOD_S
        own.rest_s = now.rest_s


class WheelOdometry:
    """Wheel pulses times the wheel's circumference."""

    def __init__(self, vehicle: Vehicle, settings: WheelSettings) -> None:
        """Begin at the first count."""
        self._settings = settings
        self._pulse_m = vehicle.metres_per_pulse
        self._ticks = TickMaker(vehicle)
        self._state = np.zeros(1, WHEEL_STATE)

    def advance(self, until_s: float, imu_t_s: Floats, imu: SixAxes, tacho_t_s: Floats, pulses: Counts) -> MotionRows:
        """Rows due until `until_s`, see `OdometryStep`; the inertial samples are not used."""
        ticks = self._ticks.advance(until_s, imu_t_s[:0], imu[:0], tacho_t_s, pulses)
        out = np.zeros(len(ticks), WHEEL_OUT)
        wheel_ticks(ticks, self._settings.hardest_mps2, self._pulse_m, self._state, out)
        unknown = np.full(len(ticks), np.nan)
        settings = self._settings
        provisional_m = out["provisional_m"] + settings.unseen_m
        silent = out["silent"] != 0
        return MotionRows(
            t_s=ticks["t_ns"] / 1e9,
            distance_m=ticks["way_m"].copy(),
            way_m=out["run_m"].copy(),
            speed_mps=ticks["wheel_speed_mps"].copy(),
            speed_bound_mps=settings.share * np.abs(ticks["wheel_speed_mps"]) + out["apart_mps"] + 0.5,
            acceleration_mps2=unknown,
            slip=out["slip"].astype(np.int8),
            standstill=out["still"].astype(np.bool_),
            bound_m=settings.share * out["run_m"] + out["excess_m"] + provisional_m,
            excess_m=out["excess_m"].copy(),
            provisional_m=provisional_m,
            status=np.where(silent, DEGRADED, VALID).astype(np.int8),
            reason=silent.astype(np.int16),
            curvature_per_m=unknown,
            curvature_sigma_per_m=unknown,
            curvature_distance_m=unknown,
            gradient_permille=unknown,
            wheel_scale=unknown,
            gyro_bias_radps=unknown,
            since_standstill_s=out["rest_s"].copy(),
            share_bound=settings.share,
            sensor_delay_s=0.0,
            reasons=REASONS,
        )

    def remembered(self) -> None:
        """Nothing is learned."""
        return
