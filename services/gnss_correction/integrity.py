"""Whether bounds keep their promise: errors against bounds, by the classes of the Stanford diagram.

Terms as in EN 16803-1 and in the diagram of Tossaint et al. 2007: with the alert limit, beyond
which a position is of no use, a fix is *available* when its bound is within the limit; information
is *misleading* when the error exceeds the bound, and *hazardously* so when it exceeds the alert
limit while the bound does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from services.gnss_correction.evaluation import FixTrack, Float64s, Polyline, errors_m


@dataclass(frozen=True, slots=True)
class BoundedErrors:
    """Fixes of one method inside the truth [m]; a bound is NaN where none is vouched for."""

    name: str
    epochs: int
    """Inside the truth, with or without a fix."""
    error_m: Float64s
    bound_m: Float64s


@dataclass(frozen=True, slots=True)
class Integrity:
    """How far the bounds of one method hold; None where there is no fix or no bound."""

    name: str
    alert_limit_m: float
    epochs: int
    fix_percent: float
    bounded_percent: float
    """Fixes with a bound, of all fixes."""
    misleading: int
    """Fixes whose error exceeds their bound; one without a bound vouches for nothing and counts too."""
    misleading_percent: float
    hazardous: int
    """Of these, errors beyond the alert limit behind a bound within it."""
    unavailable_percent: float
    """Epochs without a fix, or with a bound beyond the alert limit or none."""
    bound_p50_m: float | None
    bound_p95_m: float | None
    worst_ratio: float | None
    """Largest error over bound."""


def bounded_errors(track: FixTrack, truth: Polyline) -> BoundedErrors:
    """Errors and bounds of the fixes inside the truth."""
    error, inside = errors_m(track, truth)
    counted = inside & track.fixed
    bound = np.full(len(error), np.nan) if track.bound_m is None else track.bound_m
    return BoundedErrors(track.name, int(inside.sum()), error[counted], bound[counted])


def _percent(count: int, of: int) -> float:
    return 100.0 * count / of if of else 0.0


def integrity_of(track: BoundedErrors, alert_limit_m: float) -> Integrity:
    """Shares of the classes for an alert limit [m].

    >>> track = BoundedErrors("robust", 4, np.array([3.0, 9.0, 60.0]), np.array([10.0, 8.0, 40.0]))
    >>> result = integrity_of(track, 50.0)
    >>> result.misleading, result.hazardous, result.unavailable_percent
    (2, 1, 25.0)
    """
    error, bound, fixes = track.error_m, track.bound_m, len(track.error_m)
    bounded = np.isfinite(bound)
    misleading = ~(error <= bound)
    hazardous = misleading & (error > alert_limit_m) & (bound <= alert_limit_m)
    available = bound <= alert_limit_m
    some = bool(bounded.any())
    return Integrity(
        name=track.name,
        alert_limit_m=alert_limit_m,
        epochs=track.epochs,
        fix_percent=_percent(fixes, track.epochs),
        bounded_percent=_percent(int(bounded.sum()), fixes),
        misleading=int(misleading.sum()),
        misleading_percent=_percent(int(misleading.sum()), fixes),
        hazardous=int(hazardous.sum()),
        unavailable_percent=_percent(track.epochs - int(available.sum()), track.epochs),
        bound_p50_m=float(np.median(bound[bounded])) if some else None,
        bound_p95_m=float(np.percentile(bound[bounded], 95)) if some else None,
        worst_ratio=float((error[bounded] / np.maximum(bound[bounded], 1e-9)).max()) if some else None,
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


_ROWS: tuple[tuple[str, Callable[[Integrity], str]], ...] = (
    ("epochs inside the truth", lambda one: str(one.epochs)),
    ("with a fix [%]", lambda one: f"{one.fix_percent:.3f}"),
    ("fixes with a bound [%]", lambda one: f"{one.bounded_percent:.3f}"),
    ("misleading: error > bound", lambda one: str(one.misleading)),
    ("misleading [%]", lambda one: f"{one.misleading_percent:.3f}"),
    ("hazardously misleading", lambda one: str(one.hazardous)),
    ("unavailable [%]", lambda one: f"{one.unavailable_percent:.3f}"),
    ("bound 50 % [m]", lambda one: _number(one.bound_p50_m)),
    ("bound 95 % [m]", lambda one: _number(one.bound_p95_m)),
    ("largest error / bound", lambda one: _number(one.worst_ratio)),
)


def integrity_table(results: Sequence[Integrity]) -> str:
    """The results side by side, as plain text."""
    cells = [["", *(one.name for one in results)]]
    cells += [[label, *(figure(one) for one in results)] for label, figure in _ROWS]
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
    lines.insert(1, "-" * (sum(widths) + 2 * (len(widths) - 1)))
    return "\n".join([f"Integrity at an alert limit of {results[0].alert_limit_m:g} m", *lines])
