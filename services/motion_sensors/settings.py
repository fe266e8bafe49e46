"""Settings of the motion sensors."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from services.byte_source.settings import SerialSource, TcpSource, Text
from services.motion_sensors.can_signals import CanImuLayout, CanSignal
from services.motion_sensors.mounting import axes_rotation
from services.motion_sensors.number_rows import IMU_COLUMNS
from services.motion_sensors.vehicle_profile import PROFILES

Device = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]
Degrees = Annotated[float, Meta(ge=-45.0, le=45.0)]


class CanSource(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A CAN bus, as python-can names it."""

    interface: Text = "socketcan"
    channel: Text = "can0"


class ImuInput(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An inertial sensor: one of `serial`, `tcp` and `can`."""

    device: Device = "imu"
    serial: SerialSource | None = None
    tcp: TcpSource | None = None
    can: CanSource | None = None
    protocol: Literal["adis", "vectornav", "xsens", "rows"] = "rows"
    """Of the bytes of a serial line or TCP connection."""
    columns: tuple[str, ...] = IMU_COLUMNS
    """Of lines of numbers."""
    can_layout: CanImuLayout | None = None
    rate_hz: Annotated[float, Meta(ge=1.0, le=4000.0)] = 100.0
    latency_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    """From measurement to arrival, by the sensor's filters and its line; taken off every time."""
    axes: tuple[str, str, str] = ("x", "y", "z")
    """Sensor axes that point forward, left and up, as `x`, `-y`, …"""
    roll_deg: Degrees = 0.0
    pitch_deg: Degrees = 0.0
    yaw_deg: Degrees = 0.0
    """Small angles by which the sensor is turned against the vehicle, after `axes` (`kirotei motion calibrate`)."""
    gyro_dps_per_count: Annotated[float, Meta(gt=0.0)] = 0.1
    """ADIS alone."""
    accelerometer_mg_per_count: Annotated[float, Meta(gt=0.0)] = 1.25
    """ADIS alone."""
    accelerometer_range_mps2: Annotated[float, Meta(ge=0.0)] = 0.0
    """0: not checked."""
    gyro_range_dps: Annotated[float, Meta(ge=0.0)] = 0.0

    def __post_init__(self) -> None:
        """Refuse none or several sources, and axes that are none."""
        _one_source("imu", self.serial, self.tcp, self.can)
        if (self.can is None) != (self.can_layout is None):
            msg = "imu: can and can_layout belong together"
            raise ValueError(msg)
        axes_rotation(self.axes)


class AxleInput(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A pulse counter: one of `serial`, `tcp` and `can`."""

    device: Device = "axle1"
    serial: SerialSource | None = None
    tcp: TcpSource | None = None
    can: CanSource | None = None
    columns: tuple[str, ...] = ("t_s", "pulses")
    """Of lines of numbers; `t_s` may be left out."""
    can_signal: CanSignal | None = None
    """The counter."""
    counter_bits: Annotated[int, Meta(ge=0, le=64)] = 0
    """The counter wraps at 2 to this; 0: never, or as wide as its CAN signal."""
    backwards: bool = False
    """The counter grows when the vehicle runs backwards."""
    rate_hz: Annotated[float, Meta(ge=0.5, le=1000.0)] = 10.0
    latency_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    vehicle: str = ""
    """Name of a known vehicle; the two below go before it."""
    pulses_per_revolution: Annotated[float, Meta(gt=0.0, le=100_000.0)] | None = None
    wheel_diameter_m: Annotated[float, Meta(ge=0.2, le=2.5)] | None = None

    def __post_init__(self) -> None:
        """Refuse none or several sources, and wheels that are not known."""
        _one_source(self.device, self.serial, self.tcp, self.can)
        if (self.can is None) != (self.can_signal is None):
            msg = f"{self.device}: can and can_signal belong together"
            raise ValueError(msg)
        if self.vehicle and self.vehicle not in PROFILES:
            msg = f"{self.device}: vehicle {self.vehicle!r} is none of {', '.join(PROFILES)}"
            raise ValueError(msg)
        if not self.vehicle and None in (self.pulses_per_revolution, self.wheel_diameter_m):
            msg = f"{self.device}: give pulses_per_revolution and wheel_diameter_m, or a vehicle: {', '.join(PROFILES)}"
            raise ValueError(msg)

    @property
    def teeth(self) -> float:
        """Pulses per revolution."""
        return self.pulses_per_revolution or PROFILES[self.vehicle].pulses_per_revolution

    @property
    def diameter_m(self) -> float:
        """Wheel diameter."""
        return self.wheel_diameter_m or PROFILES[self.vehicle].wheel_diameter_m

    @property
    def modulus(self) -> int:
        """Number at which the counter wraps; 0 for never."""
        bits = self.counter_bits or (self.can_signal.bits if self.can_signal else 0)
        return 1 << bits if bits else 0


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the motion sensors: live ones, or a motion log."""

    imu: ImuInput | None = None
    axles: tuple[AxleInput, ...] = ()
    log: str = ""
    """Folder of a motion log that is played instead."""
    log_device: Device = "imu"
    log_axle: Device = "axle1"
    speed: Annotated[float, Meta(gt=0.0, le=1000.0)] = 1.0
    """Recorded seconds per second. Times move to now."""
    repeat: bool = False
    block_s: Annotated[float, Meta(ge=0.01, le=1.0)] = 0.1
    """Samples of so much time travel together."""
    silence_s: Annotated[float, Meta(ge=0.5, le=60.0)] = 2.0
    """A sensor that sends nothing for longer is opened anew."""
    largest_speed_mps: Annotated[float, Meta(gt=0.0, le=150.0)] = 100.0
    """No vehicle of this kind runs faster: what counters say beyond it is not the train's."""

    def __post_init__(self) -> None:
        """Refuse nothing to read, and twins."""
        if bool(self.log) == bool(self.imu or self.axles):
            msg = "give imu and axles, or a log"
            raise ValueError(msg)
        names = [axle.device for axle in self.axles]
        if len(set(names)) < len(names):
            msg = f"two axles have the same device name: {', '.join(names)}"
            raise ValueError(msg)


def _one_source(name: str, *sources: object) -> None:
    if sum(source is not None for source in sources) != 1:
        msg = f"{name}: give one of serial, tcp and can"
        raise ValueError(msg)
