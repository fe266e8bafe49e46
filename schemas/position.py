"""Messages about the train's place."""

from __future__ import annotations

from schemas.message import Message


class TrainTruth(Message, frozen=True, kw_only=True):
    """Where a simulated train's antenna really is (only a simulator can know)."""

    lat_deg: float
    lon_deg: float
    h_m: float
    """Ellipsoidal height [m]."""
    ve_mps: float
    vn_mps: float
    vu_mps: float
    axis_m: float
    """True metres along the line's axis."""
    speed_mps: float
    surroundings: str = ""
    """What stands around the train here ('open', 'street canyon', …)."""
