"""How a sensor sits in the vehicle, and whether what it measures agrees with that.

Vehicle axes: x forward, y left, z up. At rest the specific force is +g on z, less what gradient and cant
tilt away (35 ‰ and 200 mm of cant on 1,067 mm: below 0.2 g aside). In a curve the specific force across
is v times the yaw rate, less what cant takes.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from services.motion_sensors.imu_sample import STANDARD_GRAVITY_MPS2

Floats = NDArray[np.float64]

_AXES: Final = {"x": 0, "y": 1, "z": 2}
MOST_TILT: Final = 0.25
"""Share of gravity that gradient and cant can put across at rest, with room for mounting angles."""
_REST_RATE_RADPS: Final = 0.02
_REST_SPREAD_MPS2: Final = 0.3
CURVE_RADPS: Final = 0.03
"""Yaw rate of a curve worth judging by: R500 at 54 km/h."""
_CURVE_SPEED_MPS: Final = 5.0


def axes_rotation(axes: tuple[str, str, str]) -> Floats:
    """Rotation (3, 3) that turns sensor axes into vehicle axes, of the sensor axes that lie along x, y and z.

    Raises ValueError unless they are three different axes that make a right-handed system.

    >>> axes_rotation(("x", "-y", "-z")) @ np.array([0.0, 0.0, -9.8])
    array([0. , 0. , 9.8])
    """
    rotation = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        sign, name = (-1.0, axis[1:]) if axis.startswith("-") else (1.0, axis.removeprefix("+"))
        if name not in _AXES:
            msg = f"axis {axis!r} is none of x, y, z, -x, -y, -z"
            raise ValueError(msg)
        rotation[row, _AXES[name]] = sign
    if not math.isclose(float(np.linalg.det(rotation)), 1.0):
        msg = f"axes {', '.join(axes)} are no right-handed system: one of the signs is wrong"
        raise ValueError(msg)
    return rotation


def angles_rotation(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Floats:
    """Rotation (3, 3) that takes small mounting angles back: vehicle = R · sensor.

    The sensor is turned against the vehicle by yaw about z, then pitch about y, then roll about x, each
    right-handed.
    """
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll_rad, pitch_rad, yaw_rad) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def fault_at_rest(forces_mps2: Floats, rates_radps: Floats) -> str | None:
    """What gravity says against the axes, of samples (n, 3) at rest; empty when nothing, None when not at rest.

    At rest means: the values spread and turn no more than in a standing train.
    """
    spread = float(np.std(forces_mps2, axis=0).max())
    if spread > _REST_SPREAD_MPS2 or float(np.abs(rates_radps.mean(axis=0)).max()) > _REST_RATE_RADPS:
        return None
    mean = forces_mps2.mean(axis=0) / STANDARD_GRAVITY_MPS2
    if mean[2] >= 1.0 - MOST_TILT and max(abs(mean[0]), abs(mean[1])) <= MOST_TILT:
        return ""
    strongest = int(np.argmax(np.abs(mean)))
    name = ("-" if mean[strongest] < 0.0 else "") + "xyz"[strongest]
    return f"at rest gravity ({mean[strongest]:+.2f} g) is on {name}, not on z: the axes are not as configured"


def fault_in_curve(speed_mps: float, across_mps2: float, yaw_rate_radps: float) -> str | None:
    """What the first curve says against the axes; empty when nothing, None when this is no curve to judge by.

    Cant takes away up to the whole centripetal acceleration and, at low speed, more; against its
    sign only a wrong axis can push by more than cant allows.
    """
    if abs(yaw_rate_radps) < CURVE_RADPS or speed_mps < _CURVE_SPEED_MPS:
        return None
    expected = speed_mps * yaw_rate_radps
    if across_mps2 * math.copysign(1.0, expected) < -MOST_TILT * STANDARD_GRAVITY_MPS2 + abs(expected) * 0.5:
        return (
            f"in a curve of {yaw_rate_radps:+.3f} rad/s at {speed_mps:.0f} m/s the force across is "
            f"{across_mps2:+.2f} m/s², not near {expected:+.2f}: y or the sign of the yaw rate is wrong"
        )
    return ""
