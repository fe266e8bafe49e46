"""What a viewer knows of trains' places: position, odometry, truth where it is simulated, and what happened. Pure.

Times `now_s` and `heard_s` are monotonic seconds, as in watch_state.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from schemas.message import Message
from schemas.motion import MotionWarning, Odometry, SlipEpisode
from schemas.position import LandmarkMatch, MotionTruth, PositionEvent, ReferencePass, TrainPosition

STALE_AFTER_S: Final = 2.0
"""Twenty positions."""
KEPT_ERRORS: Final = 6000
"""Ten minutes at 10 Hz."""
KEPT_TRUTHS: Final = 200
KEPT_EVENTS: Final = 6
EVENTS_SHOWN_S: Final = 120.0
MAX_TRUTH_GAP_NS: Final = 2_000_000_000


@dataclass(slots=True)
class TrainView:
    """One train."""

    train: str
    position: TrainPosition | None = None
    heard_s: float = -math.inf
    delay_s: float = 0.0
    odometry: Odometry | None = None
    odometry_s: float = -math.inf
    truths: deque[MotionTruth] = field(default_factory=lambda: deque(maxlen=KEPT_TRUTHS))
    pending: deque[tuple[float, TrainPosition]] = field(default_factory=lambda: deque(maxlen=KEPT_TRUTHS))
    """Positions whose truth has not been heard yet."""
    error_m: float | None = None
    """True place minus estimated one, of the newest position whose truth is known."""
    errors: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_ERRORS))
    """(heard_s, size of the error [m])."""
    outside: int = 0
    """Positions whose truth lay outside their bounds."""
    events: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=KEPT_EVENTS))
    """(heard_s, what happened), newest last."""

    def age_s(self, now_s: float) -> float:
        """Time since the newest position was sent."""
        return now_s - self.heard_s + self.delay_s

    def stale(self, now_s: float) -> bool:
        """True when the newest position no longer says where the train is."""
        return self.position is None or self.age_s(now_s) > STALE_AFTER_S

    def recent_events(self, now_s: float) -> list[tuple[float, str]]:
        """Age [s] and text of what happened lately, newest first."""
        return [(now_s - at_s, text) for at_s, text in reversed(self.events) if now_s - at_s <= EVENTS_SHOWN_S]

    def take(self, message: Message, heard_s: float, delay_s: float) -> None:
        """Take a message of this train in."""
        match message:
            case TrainPosition():
                self.position, self.heard_s, self.delay_s = message, heard_s, max(0.0, delay_s)
                self.pending.append((heard_s, message))
                self._settle()
            case MotionTruth():
                if self.truths and message.t_ns < self.truths[-1].t_ns:
                    self.truths.clear()  # the simulation has begun anew
                    self.pending.clear()
                self.truths.append(message)
                self._settle()
            case Odometry():
                self.odometry, self.odometry_s = message, heard_s
            case _:
                text = event_text(message)
                if text:
                    self.events.append((heard_s, text))

    def _settle(self) -> None:
        """Give positions their errors as far as truth is known."""
        while self.pending and self.truths and self.pending[0][1].t_ns <= self.truths[-1].t_ns:
            heard_s, position = self.pending.popleft()
            true_m = place_at(self.truths, position.t_ns, position.branch)
            if true_m is None or position.axis_m is None:
                self.error_m = None
                continue
            self.error_m = true_m - position.axis_m
            self.errors.append((heard_s, abs(self.error_m)))
            ahead, behind = bounds_along_axis(position)
            if not -behind <= self.error_m <= ahead:
                self.outside += 1


def bounds_along_axis(position: TrainPosition) -> tuple[float, float]:
    """How far the train may be towards rising and falling `axis_m` from the estimate [m]; inf where not known."""
    ahead, behind = position.bound_ahead_m, position.bound_behind_m
    ends = (math.inf if ahead is None else ahead, math.inf if behind is None else behind)
    return ends if position.direction != "down" else (ends[1], ends[0])


def place_at(truths: deque[MotionTruth], t_ns: int, branch: str | None) -> float | None:
    """True `axis_m` at a time on a branch (any, when it is undecided); None where truth is not known."""
    index = bisect_left(truths, t_ns, key=lambda truth: truth.t_ns)
    if index < len(truths) and truths[index].t_ns == t_ns:
        before = after = truths[index]
        share = 0.0
    elif index in (0, len(truths)) or truths[index].t_ns - truths[index - 1].t_ns > MAX_TRUTH_GAP_NS:
        return None
    else:
        before, after = truths[index - 1], truths[index]
        share = (t_ns - before.t_ns) / (after.t_ns - before.t_ns)
    if branch is not None and branch not in (before.branch, after.branch):
        return None
    return before.axis_m + share * (after.axis_m - before.axis_m)


def event_text(message: Message) -> str:
    """One line about something that happened; empty for what is no event."""
    text = ""
    match message:
        case PositionEvent():
            text = f"{message.kind}: {message.text}"
        case SlipEpisode():
            text = _slip_text(message)
        case LandmarkMatch():
            verdict = f"taken, {message.correction_m:+.1f} m" if message.accepted else f"refused: {message.reason}"
            text = f"landmark {message.landmark} {verdict}"
        case ReferencePass():
            within = "within" if message.within else "OUTSIDE"
            text = f"{message.kind} {message.reference}: {message.error_m:+.1f} m, {within} ±{message.bound_m:.1f} m"
        case MotionWarning():
            text = f"{message.device} {message.kind}: {message.reason}"
        case _:
            pass
    return text


def _slip_text(episode: SlipEpisode) -> str:
    name = "slide" if episode.slip < 0 else "spin"
    if episode.phase == "began":
        return f"{name} began"
    gone = "" if episode.corrected_m is None else f", {episode.corrected_m:+.1f} m against the wheel"
    ended = "ended" if episode.phase == "ended" else "not over: stop demanded"
    return f"{name} {ended} after {episode.correction_s:.0f} s{gone}"
