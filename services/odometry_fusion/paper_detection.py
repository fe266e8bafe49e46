"""Slide or spin: the inertial sensor and the wheel disagree on the acceleration (Iwata et al., equation (1))."""

from __future__ import annotations

from services.numerics.kernel import kernel


@kernel
def accelerations_differ(ax_mps2: float, wheel_mps2: float, threshold_mps2: float) -> bool:
    """Equation (1): |ax - Ap| > Ta. Gravity is in ax: Ta must exceed the share of the steepest gradient."""
    return abs(ax_mps2 - wheel_mps2) > threshold_mps2
