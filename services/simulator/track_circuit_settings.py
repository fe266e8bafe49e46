"""What a simulated track circuit is: its rail, its weather, its trains, its noise."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from services.track_circuit.profile import Framing, Profile
from services.track_circuit.rail import Rail
from services.track_circuit.traction_noise import TractionSettings

Seconds = Annotated[float, Meta(ge=0.0)]
Ohms = Annotated[float, Meta(ge=0.0, le=100.0)]


class BallastPoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Leakage at a time; between two of them it changes evenly in its logarithm."""

    t_s: Seconds
    s_per_km: Annotated[float, Meta(ge=0.001, le=5.0)]


class Occupation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A train in the circuit, which runs from the sending to the receiving end."""

    enter_s: Seconds
    leave_s: Seconds
    shunt_ohm: Ohms = 0.06


class Outage(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Something that goes wrong for a while."""

    kind: Literal["broken_rail", "no_transmitter", "lost_samples", "replay"]
    begin_s: Seconds
    end_s: Seconds


class TrackCircuitSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A simulated circuit."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")] = "TC1"
    circuit_id: Annotated[int, Meta(ge=0, le=0xFFFF)] = 1
    profile: Profile = Profile(framing=Framing())
    code_hz: Annotated[float, Meta(gt=0.0)] = 16.9
    """Of a frequency-coded circuit; its carrier is the profile's first plus `carrier_offset_hz`."""
    carrier_offset_hz: float = 0.0
    clock_ppm: Annotated[float, Meta(ge=-500.0, le=500.0)] = 0.0
    rail: Rail = Rail(tuned_q=4.0)
    length_km: Annotated[float, Meta(gt=0.0, le=20.0)] = 1.0
    sending: Annotated[float, Meta(gt=0.0)] = 10.0
    """Amplitude of the source relative to the receiver's full scale."""
    ballast: tuple[BallastPoint, ...] = (BallastPoint(t_s=0.0, s_per_km=0.02),)
    trains: tuple[Occupation, ...] = ()
    outages: tuple[Outage, ...] = ()
    noise: TractionSettings = TractionSettings(white_rms=1e-3)
    neighbour: Annotated[float, Meta(ge=0.0)] = 0.0
    """Amplitude of the next circuit's signal, which has the same profile and another id, at the receiver."""
    sample_rate_hz: Annotated[float, Meta(ge=8000.0, le=384_000.0)] = 48_000.0
    block_s: Annotated[float, Meta(ge=0.02, le=0.2)] = 0.1
    payload_hex: Annotated[str, Meta(pattern="^([0-9a-f]{2})*$")] = "a55a"
    seed: Annotated[int, Meta(ge=0)] = 1

    def __post_init__(self) -> None:
        """Refuse weather without times in order."""
        times = [point.t_s for point in self.ballast]
        if not times or times != sorted(set(times)):
            msg = f"circuit {self.name}: ballast needs points with rising t_s"
            raise ValueError(msg)
