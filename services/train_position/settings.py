"""Every setting of the train's position, named, with its limits and its default."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from schemas.position import Cab

Metres = Annotated[float, Meta(ge=0.0, le=100_000.0)]
Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
Share = Annotated[float, Meta(ge=0.0, le=0.5)]


class AntennaPlace(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where an antenna stands on its train."""

    behind_m: Annotated[float, Meta(ge=0.0, le=1000.0)] = 0.0
    """Along the train, from the end of the leading cab (`forward = "vehicle"`: of cab A) to the antenna."""


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings of the position."""

    line_file: str = ""
    """Line file (JSON). Without it there are no balises, no chainage and no satellites: landmarks alone give places."""
    length_m: Annotated[float, Meta(ge=0.0, le=2000.0)] = 60.0
    """Length of the train when it starts; coupling changes it."""
    cab: Cab = "A"
    """Cab that leads when it starts."""
    forward: Literal["cab", "vehicle"] = "cab"
    """What odometry and antennas count as forward: where the leading cab looks (each cab has its own sensors, or pulse
    counters that cannot tell directions), or always where cab A looks."""
    facing: Literal["up", "down"] | None = None
    """Where forward points when the train starts, `up` for rising `axis_m`; found from references when left out."""
    antennas: dict[str, AntennaPlace] = msgspec.field(default_factory=dict)
    """Lever arms by GNSS device. Fixes of other devices are not used; `front_end` needs none."""
    state: bool = True
    """Keep the position on disk, so that it survives a restart."""
    state_folder: str = ""
    """Where; empty for the host's own folder, which a replay of a recording neither reads nor writes."""

    clock_bound_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.005
    """Largest difference between the clocks that stamp sources, while satellites discipline them."""
    holdover: Annotated[float, Meta(ge=0.0, le=1e-2)] = 2e-6
    """By how much it grows per second without satellites (a quartz of 2 ppm)."""
    line_accuracy_m: Metres = 1.0
    """Error of the line file's geometry, added to places by satellites."""
    beside_m: Metres = 5.0
    """How far an antenna may be beside the axis without speaking against the branch."""

    scale_wander_share: Share = 0.003
    """By how much the wheel's scale over one stretch may differ from that over another (creep, wear)."""
    turned_share: Share = 0.05
    """Relative error of distance after wheels were turned, until two references have told the scale."""
    most_speed_mps: Positive = 100.0
    """No train of the line is faster."""
    most_acceleration_mps2: Annotated[float, Meta(gt=0.0, le=20.0)] = 1.5
    """Nor starts or brakes harder; both bound the way gone without odometry."""
    longest_gap_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 30.0
    """Without odometry for longer the position is lost unless satellites carry it."""
    silent_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 1.0
    """Odometry that has not spoken for so long is taken to be missing."""
    late_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 2.0
    """Odometry stamped by so much longer ago than usual is late: by physics the position goes on from it to now."""
    calm_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 20.0
    """An odometry that was not believed is believed again after so long without slips: longer than slips last."""

    scant_share: Share = 0.02
    """Claims that overlap by less than this share of the narrower one contradict each other."""
    independent_s: Annotated[float, Meta(ge=0.0, le=3600.0)] = 30.0
    independent_m: Metres = 300.0
    """Satellites are evidence of their own about a contradiction so long after it began, and so far away."""
    most_valid_m: Metres = 400.0
    """A wider interval between the rearmost and the foremost place of the front end is degraded,"""
    most_known_m: Metres = 5000.0
    """and this one is lost."""
