"""Settings of the track-circuit service and of `kirotei track-circuit`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from services.track_circuit.code_table import CodeTable
from services.track_circuit.occupancy import OccupancySettings
from services.track_circuit.profile import Framing, Profile

Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")]
ReceiverName = Literal["mlse", "dfe", "least-squares", "rls", "nlms", "lms"]


class AlsaInput(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A sound device, read through `arecord`."""

    device: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_:,.=@+-]{1,64}$")] = "default"
    rate_hz: Annotated[int, Meta(ge=8000, le=384_000)] = 48_000
    channels: Annotated[int, Meta(ge=1, le=32)] = 1
    channel: Annotated[int, Meta(ge=0, le=31)] = 0
    """Which of them, counted from 0."""


class FileInput(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A recording that is played at its own pace, its times moved to now."""

    path: Annotated[str, Meta(min_length=1)]
    channel: Annotated[int, Meta(ge=0, le=31)] = 0
    repeat: bool = False


class CircuitSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One circuit and how it is received."""

    name: Name
    circuit_id: Annotated[int, Meta(ge=0, le=0xFFFF)] | None = None
    """What its telegrams call it; None: any id is taken, and telegrams never make it clear."""
    profile: Profile = Profile(framing=Framing())
    receiver: ReceiverName = "mlse"
    alsa: AlsaInput | None = None
    file: FileInput | None = None
    """Without either, samples are taken from the bus."""
    occupancy: OccupancySettings = OccupancySettings()
    length_m: Annotated[float, Meta(gt=0.0, le=20_000.0)] | None = None
    """From sending to receiving end, for the estimate of the ballast's leakage."""
    sending_axis_m: float | None = None
    """On board: where the sending end stands, for coefficients by distance from it."""
    receiving: Literal["up", "down"] = "up"
    """Side of the sending end on which the circuit lies: rising or falling axis_m."""
    learn: bool = True
    """Adapt stored coefficients gently: beside the line while clear, on board with good telegrams."""

    def __post_init__(self) -> None:
        """Refuse two inputs."""
        if self.alsa is not None and self.file is not None:
            msg = f"circuit {self.name}: give alsa or file, not both"
            raise ValueError(msg)


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which circuits are received, and how."""

    circuits: tuple[CircuitSettings, ...] = ()
    code_table: CodeTable = CodeTable()
    """Of frequency-coded circuits."""
    block_s: Annotated[float, Meta(ge=0.02, le=0.2)] = 0.1
    """Samples of an own input travel in blocks of this length."""
    aerial: Name = "aerial"
    """On board: name under which samples of the coils come, whatever circuit the train is in."""
    publish_samples: bool = False
    """Put the samples of own inputs on the bus, for recording."""
    state: bool = True
    """Keep coefficients and references on disk."""
    state_folder: str = ""
    """Where to keep them; empty for the host's state folder."""
    weather: str = ""
    """Written beside coefficients that are learned."""

    def __post_init__(self) -> None:
        """Refuse twins."""
        names = [one.name for one in self.circuits]
        if len(set(names)) < len(names):
            msg = f"two circuits have the same name: {', '.join(sorted(names))}"
            raise ValueError(msg)
