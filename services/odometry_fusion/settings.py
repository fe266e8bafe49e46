"""Every setting of odometry, named, with its limits and its default: for the service and for files alike."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.motion import OdometryMethod
from services.odometry_fusion.fused_settings import FusedSettings
from services.odometry_fusion.paper_settings import PaperSettings
from services.odometry_fusion.wheel_odometry import WheelSettings

Device = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How odometry is made of pulses and inertial samples."""

    method: OdometryMethod = "fused"
    """`wheel`: pulses alone; `paper`: Iwata et al.; `fused`: an error-state filter with prediction anchors."""
    imu: Device | None = None
    """The inertial sensor's device; without it, the first one heard."""
    axles: tuple[Device, ...] = ()
    """Devices of the pulse counters, the preferred one first; without any, those heard, in order of name."""
    imu_latency_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    """By how much the stamps of live inertial samples are late, where their reader does not take it off already
    (`kirotei motion calibrate` finds it). Files say their own."""
    max_gradient_permille: Annotated[float, Meta(ge=0.0, le=300.0)] = 35.0
    """Steepest gradient of the line."""
    imu_rest_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None
    imu_rest_radps: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None
    """How much the inertial sensor is shaken in a standing train: standard deviations over a second of its specific
    force and of its angular rates, three axes together, both or none. Until a stop has shown it, a train whose wheel
    stands may be under way with locked wheels (docs/train_position.md)."""
    longest_wait_s: Annotated[float, Meta(ge=0.05, le=5.0)] = 0.6
    """A row waits so long for samples of its period; those that come later are left out."""
    silence_s: Annotated[float, Meta(ge=0.2, le=60.0)] = 1.0
    """After so long without any sample, rows go on without them, lost."""
    state: bool = True
    """Keep biases and wheel scale on disk, for the next start."""
    state_folder: str = ""
    """Where to keep them; empty for the host's state folder."""
    fused: FusedSettings = FusedSettings()
    paper: PaperSettings = PaperSettings()
    wheel: WheelSettings = WheelSettings()
