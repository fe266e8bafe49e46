"""The paper's method at work on samples in any cut.

Iwata, Yamamichi, Sugiyama, Kitano: A Train Position Detection System Using Inertial Sensors Together with Tachometer
Generators, RTRI Report.
"""

from __future__ import annotations

import numpy as np

from services.odometry_fusion.curvature import WINDOW_TICKS, curvature_rows
from services.odometry_fusion.motion_log import (
    Counts,
    Episode,
    Floats,
    MotionRows,
    Remembered,
    SixAxes,
    Vehicle,
)
from services.odometry_fusion.paper_episode import ENDED, NO_END
from services.odometry_fusion.paper_layout import (
    EVENT,
    HISTORY,
    MOST_TRACKS,
    OUT,
    REASONS,
    SMOOTHED,
    STATE,
    TRACK,
    rules_of,
)
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.paper_step import run_ticks
from services.odometry_fusion.paper_witness import WITNESSES
from services.odometry_fusion.tick_layout import TICK, Records
from services.odometry_fusion.ticks import TickMaker

PHASES = ("began", "ended", "not_found")


class PaperOdometry:
    """Wheel while it adheres, inertial sensor from a start point to re-adhesion while it slips."""

    def __init__(self, vehicle: Vehicle, settings: PaperSettings, known: Remembered | None = None) -> None:
        """Begin at the first count; biases of an earlier run serve until the next standstill."""
        self._rules = rules_of(settings, vehicle)
        self._share = settings.share + settings.wear_share
        self._ticks = TickMaker(vehicle)
        self._state = np.zeros(1, STATE)
        self._state["since_rest_s"] = settings.bias_hold_s
        self._state["ended_ns"] = np.iinfo(np.int64).min
        if known is not None:
            self._state["roll_bias_radps"] = known.roll_bias_radps
            self._state["pitch_bias_radps"] = -known.pitch_bias_radps
            self._state["yaw_bias_radps"] = known.yaw_bias_radps
        self._state["proof_s"] = -1.0
        self._rested = False
        self._tracks = np.zeros(MOST_TRACKS, TRACK)
        self._witnesses = np.zeros(WITNESSES, TRACK)
        self._witnesses["t_s"] = -1.0
        self._past = np.empty(0, TICK)
        self._past_smoothed = np.empty(0, SMOOTHED)
        self._past_turns = np.empty((0, 3))

    def advance(self, until_s: float, imu_t_s: Floats, imu: SixAxes, tacho_t_s: Floats, pulses: Counts) -> MotionRows:
        """Rows due until `until_s`, see `OdometryStep`."""
        new = self._ticks.advance(until_s, imu_t_s, imu, tacho_t_s, pulses)
        first = len(self._past)
        ticks = np.concatenate([self._past, new])
        smoothed = np.concatenate([self._past_smoothed, np.zeros(len(new), SMOOTHED)])
        out = np.zeros(len(new), OUT)
        events = np.zeros(2 * len(new) + 1, EVENT)
        count = run_ticks(ticks, smoothed, first, self._rules, self._state, self._tracks, self._witnesses, out, events)
        rows = self._rows(new, out, self._episodes(new, events[:count]))
        self._rested = self._rested or bool(out["standstill"].any())
        kept = max(0, len(ticks) - HISTORY)
        self._past, self._past_smoothed = ticks[kept:], smoothed[kept:]
        return rows

    def remembered(self) -> Remembered | None:
        """Biases of the gyros, once the train has stood."""
        if not self._rested:
            return None
        now = self._state[0]
        return Remembered(float(now["roll_bias_radps"]), -float(now["pitch_bias_radps"]), float(now["yaw_bias_radps"]))

    def _rows(self, new: Records, out: Records, episodes: tuple[Episode, ...]) -> MotionRows:
        curvature = self._curvature(out)
        return MotionRows(
            t_s=new["t_ns"] / 1e9,
            distance_m=out["distance_m"].copy(),
            way_m=out["run_m"].copy(),
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
            wheel_scale=np.full(len(out), np.nan),
            gyro_bias_radps=-out["gyro_bias_radps"],
            since_standstill_s=out["since_rest_s"].copy(),
            share_bound=self._share,
            sensor_delay_s=0.0,
            reasons=REASONS,
            episodes=episodes,
        )

    def _curvature(self, out: Records) -> Floats:
        usable = (out["slip"] == 0) & (out["status"] == 0)
        turns = np.concatenate(
            [self._past_turns, np.column_stack([out["yaw_radps"], out["sensed_m"], usable.astype(np.float64)])]
        )
        found = np.empty((len(out), 3))
        columns = [np.ascontiguousarray(turns[:, k]) for k in range(3)]
        curvature_rows(columns[0], columns[1], columns[2], len(self._past_turns), found)
        self._past_turns = turns[-WINDOW_TICKS - 1 :]
        return found

    def _episodes(self, new: Records, events: Records) -> tuple[Episode, ...]:
        return tuple(
            Episode(
                t_s=float(new["t_ns"][event["row"]]) / 1e9,
                number=int(event["episode"]),
                phase=PHASES[int(event["phase"])],  # type: ignore[arg-type]  # the codes are those words
                slip=1 if event["slip"] > 0 else -1,
                start_t_s=float(event["start_ns"]) / 1e9,
                correction_s=float(event["correction_s"]),
                corrected_m=float(event["corrected_m"]) if event["phase"] == ENDED else None,
                bound_m=float(event["bound_m"]),
                stop_demanded=bool(event["phase"] == NO_END),
                reason="",
            )
            for event in events
        )
