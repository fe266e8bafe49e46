"""The fused mode at work on samples in any cut: an error-state filter in several branches."""

from __future__ import annotations

import numpy as np

from services.odometry_fusion.curvature import WINDOW_TICKS, curvature_rows
from services.odometry_fusion.fused_layout import (
    BRANCH,
    ENDED,
    EVENT,
    NOT_FOUND,
    NOW,
    OUT,
    PHASES,
    REASONS,
    ROOM,
    RULES,
    SIZE,
    Branches,
)
from services.odometry_fusion.fused_origin import begin_now
from services.odometry_fusion.fused_settings import FusedSettings
from services.odometry_fusion.fused_step import run_ticks
from services.odometry_fusion.motion_log import Counts, Episode, Floats, MotionRows, Remembered, SixAxes, Vehicle
from services.odometry_fusion.tick_layout import Records
from services.odometry_fusion.ticks import TickMaker

LARGEST_SCALE = 0.1
"""A wheel whose scale is further off is another wheel."""
STALE_SIGMA = 0.01
"""Of a scale kept from an earlier run: wheels may have been turned meanwhile, so that all of wear is vouched for
until a reference has told it again."""
BETTER_SHARE = 0.8
"""A scale that is known better by so much is taken, though it be the same."""


class FusedOdometry:
    """Wheel and inertial sensor in one filter, with accounts of slips weighed side by side."""

    def __init__(self, vehicle: Vehicle, settings: FusedSettings, known: Remembered | None = None) -> None:
        """Begin at the first count; biases of an earlier run serve until the next standstill."""
        self._settings = settings
        self._rules = np.zeros(1, RULES)
        self._rules["pulse_m"] = vehicle.metres_per_pulse
        self._rules["latency_s"] = vehicle.imu_latency_s
        self._rules["share"] = settings.share
        self._rules["longest_slip_s"] = settings.longest_slip_s
        self._rules["start_bound_m"] = settings.start_bound_m
        self._ticks = TickMaker(vehicle)
        self._state = np.zeros(1, NOW)
        begin_now(self._state[0])
        self._branches = Branches(np.zeros((ROOM, SIZE)), np.zeros((ROOM, SIZE, SIZE)), np.zeros(ROOM, BRANCH))
        self._past_turns = np.empty((0, 3))
        if known is not None:
            self._state["roll_bias_radps"] = known.roll_bias_radps
            self._state["yaw_bias_radps"] = known.yaw_bias_radps
            if known.wheel_scale is not None and known.wheel_scale_sigma > 0.0:
                self.update_scale(known.wheel_scale, max(known.wheel_scale_sigma, STALE_SIGMA))

    def take_scale(self, scale: float, sigma: float) -> bool:
        """Take a scale that tells something new, see `update_scale`; gives whether it did."""
        old, old_sigma = float(self._state["scale"][0]), float(self._state["scale_sigma"][0])
        if old_sigma > 0.0 and abs(scale - old) <= min(sigma, old_sigma) and sigma > BETTER_SHARE * old_sigma:
            return False
        self.update_scale(scale, sigma)
        return True

    def update_scale(self, scale: float, sigma: float) -> None:
        """Take a wheel scale found from references (true over nominal diameter) and its standard deviation.

        Distances from now on are true metres to within 3 sigma and what micro-slip adds; those so far stay.
        Raises ValueError for what can be no wheel.
        """
        if not (abs(scale - 1.0) <= LARGEST_SCALE and 0.0 < sigma < LARGEST_SCALE):
            msg = f"wheel scale {scale:g} ± {sigma:g}: a share near 1 and its standard deviation are expected"
            raise ValueError(msg)
        state = self._state
        state["origin_m"], state["origin_d_m"] = state["distance_m"], state["live_d_m"]
        state["scale"], state["scale_sigma"] = scale, sigma
        known = min(self._settings.share, self._settings.known_share + 3.0 * sigma)
        # The bound so far was taken with the former share: what falls away of it stays owed, to the origin alone.
        state["owed_m"] += max(0.0, float(self._rules["share"][0]) - known) * state["way_m"]
        self._rules["share"] = known

    def advance(self, until_s: float, imu_t_s: Floats, imu: SixAxes, tacho_t_s: Floats, pulses: Counts) -> MotionRows:
        """Rows due until `until_s`, see `OdometryStep`."""
        new = self._ticks.advance(until_s, imu_t_s, imu, tacho_t_s, pulses)
        out = np.zeros(len(new), OUT)
        events = np.zeros(2 * len(new) + 1, EVENT)
        count = run_ticks(new, self._rules, self._state, self._branches, out, events)
        return self._rows(new, out, self._episodes(new, events[:count]))

    def remembered(self) -> Remembered | None:
        """Biases of the gyros, once the train has stood, and the wheel's scale where references gave it."""
        now = self._state[0]
        if now["rested_s"] == 0.0 and now["scale_sigma"] == 0.0:
            return None
        pitch = float(self._branches.x[int(now["best"]), 4])
        sigma = float(now["scale_sigma"])
        scale = float(now["scale"]) if sigma > 0.0 else None
        return Remembered(float(now["roll_bias_radps"]), pitch, float(now["yaw_bias_radps"]), scale, sigma)

    def _rows(self, new: Records, out: Records, episodes: tuple[Episode, ...]) -> MotionRows:
        curvature = self._curvature(out)
        return MotionRows(
            t_s=new["t_ns"] / 1e9,
            distance_m=out["distance_m"].copy(),
            way_m=out["way_m"].copy(),
            speed_mps=out["speed_mps"].copy(),
            speed_bound_mps=out["speed_bound_mps"].copy(),
            acceleration_mps2=out["acceleration_mps2"].copy(),
            slip=out["slip"].astype(np.int8),
            standstill=out["standstill"].astype(np.bool_),
            bound_m=out["bound_m"].copy(),
            excess_m=out["excess_m"].copy(),
            provisional_m=out["provisional_m"].copy(),
            status=out["status"].astype(np.int8),
            reason=out["reason"].astype(np.int16),
            curvature_per_m=curvature[:, 0],
            curvature_sigma_per_m=curvature[:, 1],
            curvature_distance_m=curvature[:, 2],
            gradient_permille=out["gradient_permille"].copy(),
            wheel_scale=out["wheel_scale"].copy(),
            gyro_bias_radps=out["gyro_bias_radps"].copy(),
            since_standstill_s=out["since_rest_s"].copy(),
            share_bound=float(self._rules["share"][0]),
            sensor_delay_s=0.0,
            reasons=REASONS,
            episodes=episodes,
        )

    def _curvature(self, out: Records) -> Floats:
        usable = (out["slip"] == 0) & (out["status"] == 0)
        turns = np.concatenate(
            [self._past_turns, np.column_stack([out["yaw_radps"], out["sensed_distance_m"], usable.astype(np.float64)])]
        )
        found = np.empty((len(out), 3))
        columns = [np.ascontiguousarray(turns[:, k]) for k in range(3)]
        curvature_rows(columns[0], columns[1], columns[2], len(self._past_turns), found)
        self._past_turns = turns[-WINDOW_TICKS - 1 :]
        return found

    def _episodes(self, new: Records, events: Records) -> tuple[Episode, ...]:
        found = []
        for event in events:
            t_s, correction_s, phase = (
                float(new["t_ns"][event["row"]]) / 1e9,
                float(event["correction_s"]),
                int(event["phase"]),
            )
            found.append(
                Episode(
                    t_s=t_s,
                    number=int(event["episode"]),
                    phase=PHASES[phase],
                    slip=1 if event["slip"] > 0 else -1,
                    start_t_s=t_s - correction_s,
                    correction_s=correction_s,
                    corrected_m=float(event["corrected_m"]) if phase == ENDED else None,
                    bound_m=float(event["bound_m"]),
                    stop_demanded=phase == NOT_FOUND,
                    reason="",
                )
            )
        return tuple(found)
