"""Every setting of the correction, named, with its limits and its default: for the service and for files alike."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from schemas.gnss import Method
from services.gnss_correction.front_end import Antenna, Facing
from services.gnss_correction.weighting import Weights

Degrees = Annotated[float, Meta(ge=0.0, le=90.0)]
Positive = Annotated[float, Meta(gt=0.0)]


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How positions are made of epochs. The paper is Yoshinaga et al. 2008."""

    method: Method = "robust"
    """What is published as the fix: `original` uses every satellite, `remove` leaves out those held for multipath,
    `adjust` puts the pseudorange that was to be expected in place of theirs; `robust` filters pseudoranges and
    Dopplers with robust weights and bounds its error; `line` follows the train along `line_file`."""
    line_file: str = ""
    """Line file (JSON) or CSV polyline of the line on which the train runs: for `line`, and for the chainage of fixes
    by every other method."""
    antenna_above_line_m: Annotated[float, Meta(ge=-10.0, le=20.0)] = 0.0
    """Height of the antenna above the line's heights, which are the rail's, for the method `line`."""
    compare: tuple[Method, ...] = ("original", "remove")
    """Other methods whose fixes are published beside it."""
    systems: Annotated[str, Meta(pattern="^[GRECJ]{1,5}$")] = "GRECJ"
    """Constellations: G GPS, R GLONASS, E Galileo, C BeiDou, J QZSS."""
    weights: Weights = "cn0"
    """`cn0`: by C/N0 and elevation; `elevation`: by elevation alone."""
    elevation_mask_deg: Degrees = 5.0
    """Lower satellites are left out."""
    cn0_mask_dbhz: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.0
    """Weaker satellites are left out; 0 keeps all."""
    cn0_averaging_s: Annotated[float, Meta(ge=0.0, le=60.0)] = 1.0
    """Time constant with which C/N0 is averaged for weights and mask; 0 takes each value as it is."""
    smooth_s: Annotated[float, Meta(ge=0.0, le=3_600.0)] = 0.0
    """Time constant with which pseudoranges are smoothed by the carrier phase (Hatch 1982); 0 does not smooth. 100 s
    is usual; in town slips leave little of it."""
    reference: Annotated[str, Meta(pattern=r"^$|^[A-Za-z0-9][A-Za-z0-9_.@+-]{0,63}$")] = ""
    """Wayside place whose reference station corrects the pseudoranges; empty for whichever on the line speaks first."""
    longest_correction_age_s: Annotated[float, Meta(gt=0.0, le=600.0)] = 30.0
    """Corrections of a reference station are used for so long after the instant for which they were made."""
    most_pdop: Positive = 30.0
    """With a larger position dilution of precision the height of an earlier fix is held, or there is no fix."""
    longest_height_hold_s: Annotated[float, Meta(ge=0.0)] = 30.0
    """How old a fix may be whose height is held; 0 holds none."""
    acceleration_mps2: Annotated[float, Meta(gt=0.0, le=50.0)] = 1.0
    """Density of the horizontal acceleration in `robust` per root hertz: trains start and brake at about this."""
    bound_factor: Annotated[float, Meta(ge=1.0, le=10.0)] = 3.8
    """Standard deviations in the horizontal bound of `robust`."""
    threshold_m: Positive = 0.45
    """A change of pseudorange per 0.2 s that differs from its mean by more is held for multipath (paper, 4.4)."""
    thresholds_file: str = ""
    """TOML file with the receiver's own thresholds, as `kirotei gnss tune` writes it; where it covers a satellite it
    goes before `threshold_m` and what is added near the horizon."""
    near_horizon_extra_m: Annotated[float, Meta(ge=0.0)] = 0.3
    """Added to the threshold for satellites near the horizon (paper, 4.4)."""
    near_horizon_deg: Degrees = 10.0
    """Elevation below which a satellite is near the horizon. The paper says `extremely low` and gives no figure."""
    window_epochs: Annotated[int, Meta(ge=1, le=100)] = 5
    """Epochs in the mean (paper, 3.1.2)."""
    mean_includes_current: bool = False
    """Whether the change under judgement is in the mean it is compared with. The paper leaves it open; its `past five
    epochs` reads as without."""
    longest_adjusting_s: Annotated[float, Meta(ge=0.0)] = 10.0
    """A pseudorange is substituted for at most this long; then the satellite is left out until it is clean. The paper
    sets no limit."""
    longest_gap_s: Positive = 1.5
    """A satellite that was away longer is watched from anew; receivers of 1 Hz stay below. The paper does not speak of
    gaps."""
    antennas: dict[str, Antenna] = msgspec.field(default_factory=dict)
    """Lever arms by device, for a train with several antennas: `front_end` is published for them."""
    facing: Facing | None = None
    """Where the front end looks, `up` for rising chainage; needed where a single antenna must tell the front end."""
