"""What a viewer knows of trains and services, folded from what it has heard. Pure.

Times `now_s` and `heard_s` are monotonic seconds; ages add the time that a message was
under way (receive minus send time, so two hosts' clocks must agree to about a second).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, field

from schemas.gnss import Fix
from schemas.health import Health
from schemas.message import Message
from schemas.position import TrainTruth
from services.runtime.watch_trains import TrainView

STALE_AFTER_S = 2.0
"""Ten epochs of a 5 Hz receiver."""
LOST_AFTER_S = 5.0
"""A router's restart hides a service for up to 2.5 s; one that is silent for longer is lost."""
KEPT_ERRORS = 3000
"""Errors per method behind the running figures: ten minutes at 5 Hz."""
KEPT_TRUTHS = 100
MAX_TRUTH_GAP_NS = 2_000_000_000
"""Truth is interpolated between samples at most this far apart."""
MAX_ROWS = 200
"""Methods and services kept; a flood of names must not fill the memory."""
_WGS84_A_M = 6_378_137.0
_WGS84_E2 = 6.694379990141e-3


@dataclass(slots=True)
class MethodView:
    """One method of one receiver."""

    method: str
    primary: bool
    fix: Fix | None = None
    heard_s: float = -math.inf
    delay_s: float = 0.0
    """Time the newest fix was under way [s]."""
    error_m: float | None = None
    """Error of the newest fix whose truth is known; None when the newest fix has no position."""
    errors: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_ERRORS))
    """(heard_s, error [m])."""
    pending: deque[tuple[float, Fix]] = field(default_factory=lambda: deque(maxlen=KEPT_TRUTHS))
    """Fixes whose truth has not been heard yet."""

    def age_s(self, now_s: float) -> float:
        """Time since the newest fix was sent [s]."""
        return now_s - self.heard_s + self.delay_s

    def stale(self, now_s: float) -> bool:
        """True when the newest fix no longer says where the train is."""
        return self.age_s(now_s) > STALE_AFTER_S

    def mean_m(self) -> float | None:
        """Mean of the kept errors [m]."""
        return math.fsum(error for _, error in self.errors) / len(self.errors) if self.errors else None

    def quantile_m(self, share: float) -> float | None:
        """Smallest kept error that `share` of them do not exceed [m]."""
        if not self.errors:
            return None
        ordered = sorted(error for _, error in self.errors)
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


@dataclass(slots=True)
class DeviceView:
    """One receiver of one train."""

    train: str
    device: str
    methods: dict[str, MethodView] = field(default_factory=dict)
    truths: deque[TrainTruth] = field(default_factory=lambda: deque(maxlen=KEPT_TRUTHS))
    truth_heard_s: float = -math.inf

    def surroundings(self, now_s: float) -> str:
        """What stands around the train now; empty when not known, or no longer."""
        known = self.truths and now_s - self.truth_heard_s <= STALE_AFTER_S
        return self.truths[-1].surroundings if known else ""

    def ordered(self) -> list[MethodView]:
        """The primary method first, then the others by name."""
        return sorted(self.methods.values(), key=lambda view: (not view.primary, view.method))


@dataclass(slots=True)
class ServiceView:
    """One service, by its newest health."""

    source: str
    health: Health
    heard_s: float
    delay_s: float
    rate_hz: float | None = None
    """Messages published per second between the last two reports."""
    restarts: int = 0
    """Starts of this service that the viewer has seen after the first."""
    gone: bool = False
    """Its liveliness token has been away for too long."""

    def age_s(self, now_s: float) -> float:
        """Time since the newest report was sent [s]."""
        return now_s - self.heard_s + self.delay_s

    def lost(self, now_s: float) -> bool:
        """True when the service has been silent, or without its liveliness token, for too long."""
        return self.gone or self.age_s(now_s) > LOST_AFTER_S

    def missing(self) -> int:
        """Messages that never reached the service."""
        return sum(entry.missing for entry in self.health.inputs)


@dataclass(slots=True)
class WatchState:
    """Everything on one screen."""

    line: str
    devices: dict[tuple[str, str], DeviceView] = field(default_factory=dict)
    services: dict[str, ServiceView] = field(default_factory=dict)
    trains: dict[str, TrainView] = field(default_factory=dict)
    crowded: bool = False
    """Some names were left out: there were too many."""

    def take_fix(self, train: str, device: str, fix: Fix, *, primary: bool, heard_s: float, delay_s: float) -> None:
        """Take a fix in."""
        view = self._device(train, device)
        if view is None:
            return
        row = view.methods.get(fix.method)
        if row is None:
            row = view.methods[fix.method] = MethodView(fix.method, primary)
        row.primary = primary
        row.fix, row.heard_s, row.delay_s = fix, heard_s, max(0.0, delay_s)
        if fix.lat_deg is None:
            row.error_m = None
        else:
            row.pending.append((heard_s, fix))
            _settle(view, row)

    def take_truth(self, train: str, device: str, truth: TrainTruth, heard_s: float) -> None:
        """Take a truth in; it may complete errors of fixes heard before."""
        view = self._device(train, device)
        if view is None:
            return
        if view.truths and truth.t_ns < view.truths[-1].t_ns:
            view.truths.clear()  # the simulation has begun anew
            for row in view.methods.values():
                row.pending.clear()
        view.truths.append(truth)
        view.truth_heard_s = heard_s
        for row in view.methods.values():
            _settle(view, row)

    def take_of_train(self, train: str, message: Message, heard_s: float, delay_s: float) -> None:
        """Take in what a train says about its place."""
        view = self.trains.get(train)
        if view is None:
            if len(self.trains) >= MAX_ROWS:
                self.crowded = True
                return
            view = self.trains[train] = TrainView(train)
        view.take(message, heard_s, delay_s)

    def take_alive(self, source: str, boot_id: str, *, alive: bool) -> None:
        """Take in that a start of a service lives, or was lost."""
        view = self.services.get(source)
        if view is not None and view.health.boot_id == boot_id:
            view.gone = not alive

    def take_health(self, source: str, health: Health, heard_s: float, delay_s: float) -> None:
        """Take a service's report in."""
        before = self.services.get(source)
        if before is None and len(self.services) >= MAX_ROWS:
            self.crowded = True
            return
        view = ServiceView(source, health, heard_s, max(0.0, delay_s))
        if before is not None:
            view.restarts, view.rate_hz = before.restarts, before.rate_hz
            elapsed_s = health.uptime_s - before.health.uptime_s
            if health.boot_id != before.health.boot_id:
                view.restarts += 1
                view.rate_hz = None
            elif elapsed_s > 0.5:  # noqa: PLR2004 - an extra report at a change of level gives no steady rate
                view.rate_hz = (health.published - before.health.published) / elapsed_s
        self.services[source] = view

    def _device(self, train: str, device: str) -> DeviceView | None:
        view = self.devices.get((train, device))
        if view is None:
            if len(self.devices) >= MAX_ROWS:
                self.crowded = True
                return None
            view = self.devices[train, device] = DeviceView(train, device)
        return view


def _settle(view: DeviceView, row: MethodView) -> None:
    """Give pending fixes their errors as far as truth is known."""
    while row.pending and view.truths and row.pending[0][1].t_ns <= view.truths[-1].t_ns:
        heard_s, fix = row.pending.popleft()
        truth = truth_at(view.truths, fix.t_ns)
        if truth is None or fix.lat_deg is None or fix.lon_deg is None:
            continue
        error_m = horizontal_distance_m(fix.lat_deg, fix.lon_deg, *truth)
        row.errors.append((heard_s, error_m))
        row.error_m = error_m


def truth_at(truths: deque[TrainTruth], t_ns: int) -> tuple[float, float] | None:
    """True latitude and longitude [deg] at a time, between the two samples around it; None where there are none."""
    index = bisect_left(truths, t_ns, key=lambda truth: truth.t_ns)
    if index < len(truths) and truths[index].t_ns == t_ns:
        return truths[index].lat_deg, truths[index].lon_deg
    if index in (0, len(truths)):
        return None
    before, after = truths[index - 1], truths[index]
    span_ns = after.t_ns - before.t_ns
    if span_ns > MAX_TRUTH_GAP_NS:
        return None
    share = (t_ns - before.t_ns) / span_ns
    return (
        before.lat_deg + share * (after.lat_deg - before.lat_deg),
        before.lon_deg + share * (after.lon_deg - before.lon_deg),
    )


def horizontal_distance_m(lat_deg: float, lon_deg: float, true_lat_deg: float, true_lon_deg: float) -> float:
    """Distance along the ellipsoid between near points [m], by the radii of curvature (WGS 84).

    Better than 1e-4 of the distance up to 10 km, poles excepted.

    >>> round(horizontal_distance_m(0.0, 0.0, 0.0, 0.001), 2)
    111.32
    """
    middle = math.radians((lat_deg + true_lat_deg) / 2)
    w = math.sqrt(1.0 - _WGS84_E2 * math.sin(middle) ** 2)
    north_m = math.radians(lat_deg - true_lat_deg) * _WGS84_A_M * (1.0 - _WGS84_E2) / w**3
    turn_deg = math.remainder(lon_deg - true_lon_deg, 360.0)
    east_m = math.radians(turn_deg) * _WGS84_A_M / w * math.cos(middle)
    return math.hypot(north_m, east_m)
