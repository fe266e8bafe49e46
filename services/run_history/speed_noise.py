"""How much noise of the measured speeds is left in the acceleration, run by run.

What the smoother makes of a white noise of the speed is known in closed form. For a speed that two integrations of a
white jerk make, smoothing passes 1 / (1 + (ω/ω₀)⁴) with ω₀⁴ = jerk over the noise's density; squared, times ω², and
integrated over all frequencies, noise of variance s² every dt seconds leaves s² dt ω₀³ √2/16 in the acceleration. A
mean over a window w, differentiated, leaves s²/w². The variance is read from what the smoothed speed leaves over.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.run_history.middle import median_of
from services.run_history.track_smoothing import JERK, SPEED_SIGMA_MPS

Floats = NDArray[np.float64]
MOVING_MPS: Final = 3.0
FEWEST: Final = 20


def acceleration_noise_mps2(t_s: Floats, measured_mps: Floats, smoothed_mps: Floats, window_s: float | None) -> float:
    """Standard deviation of the noise in the acceleration of a run; 0 where too few speeds tell. Shapes (n,).

    `smoothed_mps` without sign; `window_s`: width of the moving average, None for the smoother.
    """
    told = np.isfinite(measured_mps) & (smoothed_mps > MOVING_MPS)
    if told.sum() < FEWEST:
        return 0.0
    speed_mps = 1.483 * median_of(np.abs(measured_mps - smoothed_mps)[told])
    if window_s is not None:
        return speed_mps / window_s
    step_s = median_of(np.diff(t_s))
    corner = (JERK / (SPEED_SIGMA_MPS**2 * step_s)) ** 0.25
    return float(speed_mps * np.sqrt(step_s * corner**3 * np.sqrt(2.0) / 16.0))
