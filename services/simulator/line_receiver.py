"""A receiver on a train's roof along a line: epochs driven by the train's own motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schemas.gnss_time import NS
from schemas.position import TrainTruth
from services.line.alignment import Alignment
from services.numerics.geodesy import enu_from_ecef_rotation, geodetic_from_ecef
from services.simulator.line_scene import Foliage, scene_boxes
from services.simulator.local_plane import LocalPlane
from services.simulator.paths import Paths, paths_to
from services.simulator.receiver import ReceiverChannels
from services.simulator.receiver_clock import ReceiverClock
from services.simulator.simulation import Instant, epoch_of, utc_ns
from services.simulator.sky import VisibleSky
from services.simulator.street_scene import OPEN
from services.simulator.surroundings import Surroundings
from services.simulator.train_scenario import Gnss, TrainScenario

Floats = NDArray[np.float64]
REACH_M = 2.0
"""The direction of running is taken over twice this."""


class LineReceiver:
    """One antenna and its receiver."""

    def __init__(
        self, scenario: TrainScenario, gnss: Gnss, alignment: Alignment, generator: np.random.Generator
    ) -> None:
        """Draw sky, surroundings and receiver."""
        receiver = scenario.receiver
        self._alignment, self._gnss, self._generator = alignment, gnss, generator
        middle = alignment.position(alignment.length_m / 2)
        self.plane = LocalPlane(float(middle[0]), float(middle[1]), float(middle[2]))
        self.sky = VisibleSky(scenario.sky, generator)
        self._surroundings = Surroundings(scene_boxes(alignment, self.plane, generator))
        self._foliage = Foliage(len(self.sky.satellites))
        self._channels = ReceiverChannels(receiver, len(self.sky.satellites), generator)
        self._clock = ReceiverClock(
            bias_s=receiver.clock_bias_s,
            drift=receiver.clock_drift,
            walk=receiver.clock_drift_walk,
            step_s=receiver.clock_jump_s,
        )
        self._last_ns: int | None = None

    def epoch(self, tag_ns: int, axis_m: float, speed_mps: float, *, rises: bool, received: bool = True) -> Instant:
        """Epoch tagged `tag_ns` [ns since the GPS epoch] with the front end at `axis_m`.

        `rises` tells whether `axis_m` rises as the train runs; the antenna follows the front end. When
        nothing is `received` (an antenna torn off) the epoch is empty, as it is in a tunnel.
        """
        passed_s = 0.0 if self._last_ns is None else (tag_ns - self._last_ns) / NS
        self._clock.advance(passed_s, float(self._generator.standard_normal()))
        self._last_ns = tag_ns
        bias_s = self._clock.bias_s
        sign = 1.0 if rises else -1.0
        rate_mps = sign * speed_mps
        antenna_m = axis_m - sign * self._gnss.antenna_behind_front_m - rate_mps * bias_s
        position, velocity, truth = self._antenna(tag_ns, antenna_m, rate_mps)
        arrivals = self.sky.arrivals(tag_ns, bias_s, position, velocity)
        satellite = self._channels.visible(arrivals.elevation_rad)
        turn = self.plane.enu_from_ecef
        paths = paths_to(
            self._surroundings, self.plane.xyz(position), turn @ velocity, arrivals.towards[satellite] @ turn.T
        )
        loss_db = self._foliage.loss_db(antenna_m, arrivals.elevation_rad, self._generator)[satellite]
        shade = 10.0 ** (-loss_db / 20.0) if truth.surroundings == "forest" else np.ones(len(satellite))
        if truth.surroundings == "tunnel" or not received:
            shade = np.zeros(len(satellite))
        paths = Paths(paths.amplitude * shade[:, None], paths.excess_m, paths.excess_rate_mps, paths.facade)
        measured = self._channels.measure(
            tag_ns / NS, satellite, arrivals, paths, (bias_s, self._clock.drift), self._generator
        )
        names = self.sky.satellites
        return Instant(
            epoch=epoch_of(tag_ns, names, measured),
            truth=truth,
            code_error_m=measured.code_error_m,
            visible=tuple(names[i] for i in satellite),
            reception=tuple(paths.reception()),
        )

    def _antenna(self, tag_ns: int, axis_m: float, rate_mps: float) -> tuple[Floats, Floats, TrainTruth]:
        """Earth-fixed place and velocity of the antenna, and the truth message."""
        around = self._alignment.axis.at(np.array([axis_m - REACH_M, axis_m, axis_m + REACH_M]))
        ahead = around[2] - around[0]
        velocity = rate_mps * ahead / max(float(np.linalg.norm(ahead)), 1e-9)
        lat, lon, height = geodetic_from_ecef(*around[1])
        enu = enu_from_ecef_rotation(float(lat), float(lon))
        position = around[1] + self._gnss.antenna_above_rail_m * enu[2]
        local = enu @ velocity
        kinds = [one.kind for one in self._alignment.surroundings(axis_m)]
        truth = TrainTruth(
            t_ns=utc_ns(tag_ns),
            lat_deg=float(np.degrees(lat)),
            lon_deg=float(np.degrees(lon)),
            h_m=float(height) + self._gnss.antenna_above_rail_m,
            ve_mps=float(local[0]),
            vn_mps=float(local[1]),
            vu_mps=float(local[2]),
            axis_m=axis_m,
            speed_mps=rate_mps,
            surroundings="tunnel" if "tunnel" in kinds else (str(kinds[0]) if kinds else OPEN),
        )
        return position, velocity, truth
