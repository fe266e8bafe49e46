"""What both sensors say at one instant of the 10 Hz process."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Records = NDArray[np.void]

TICK: Final[np.dtype[Any]] = np.dtype([
    ("t_ns", np.int64),
    *(
        (name, np.float64)
        for name in (
            # mean over the samples of the last period; the last one where there is none
            "ax_mps2",
            "ay_mps2",
            "az_mps2",
            "gx_radps",
            "gy_radps",
            "gz_radps",
            # for how long there has been no usable inertial sample
            "imu_missing_s",
            # way of the wheel's rim now, and at the instant that the inertial sample shows
            "way_m",
            "aligned_m",
            "wheel_speed_mps",
            # age of the last count, less the usual time between counts
            "tacho_missing_s",
            # by how much the way may be wrong since the last tick because the counter began anew
            "doubt_m",
            # by how much the way grows at least from count to count: a pulse, or what the counter waits for
            "quantum_m",
        )
    ),
])  # fmt: skip
"""One instant; ways count from the first sample."""
