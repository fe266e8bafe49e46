"""Messages of satellite positioning: what receivers measure, what is made of it.

Satellites are named as in RINEX 3: system letter (G GPS, R GLONASS, E Galileo, C BeiDou,
J QZSS, S SBAS) and two digits. GPS time is given as week (counted from 1980) and time of
week; `t_ns` is the same instant in UTC.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from schemas.arrays import Float64s, Uint8s
from schemas.message import Message, Part, require_columns

Satellite = Annotated[str, Meta(pattern="^[GRECJSI][0-9]{2}$")]
Metres = Annotated[float, Meta(ge=0.0)]
FixStatus = Literal["fix", "predicted", "none"]
OwnMode = Literal[
    "none", "autonomous", "differential", "rtk_float", "rtk_fixed", "precise", "estimated", "manual", "simulated"
]
"""How a receiver found its own position (NMEA 0183, GGA quality)."""
Method = Literal["original", "remove", "adjust", "robust", "line"]


class Epoch(Message, frozen=True, kw_only=True):
    """Everything one receiver measured at one instant of its own clock.

    Row i of every column belongs to `satellites[i]` on `signals[i]` (RINEX 3 band and
    attribute, '1C'). Columns have shape (n,); NaN where the receiver gave nothing.
    """

    gps_week: int
    tow_s: float
    """Time of week by the receiver's clock [s]."""
    satellites: tuple[Satellite, ...]
    signals: tuple[str, ...]
    pseudorange_m: Float64s
    carrier_phase_cycles: Float64s
    doppler_hz: Float64s
    """Positive when the satellite approaches (RINEX)."""
    cn0_dbhz: Float64s
    lock_lost: Uint8s
    """RINEX loss-of-lock indicator, bits 0-2; 0 when unknown."""

    def __post_init__(self) -> None:
        """Refuse columns of different lengths."""
        count = len(self.satellites)
        if len(self.signals) != count:
            msg = f"{len(self.signals)} signals for {count} satellites"
            raise ValueError(msg)
        require_columns(
            count,
            np.float64,
            pseudorange_m=self.pseudorange_m,
            carrier_phase_cycles=self.carrier_phase_cycles,
            doppler_hz=self.doppler_hz,
            cn0_dbhz=self.cn0_dbhz,
        )
        require_columns(count, np.uint8, lock_lost=self.lock_lost)


class KeplerOrbit(Part, frozen=True, kw_only=True, tag="kepler"):
    """Broadcast Keplerian elements (IS-GPS-200 table 20-III; Galileo and BeiDou alike)."""

    sqrt_a: float
    """Square root of the semi-major axis [m^0.5]."""
    eccentricity: float
    m0_rad: float
    delta_n_radps: float
    omega0_rad: float
    omega_dot_radps: float
    omega_rad: float
    i0_rad: float
    i_dot_radps: float
    cuc_rad: float
    cus_rad: float
    crc_m: float
    crs_m: float
    cic_rad: float
    cis_rad: float


class StateVectorOrbit(Part, frozen=True, kw_only=True, tag="state_vector"):
    """GLONASS state at the reference time, PZ-90 Earth-fixed (GLONASS ICD 5.1, 3.3.3)."""

    position_m: tuple[float, float, float]
    velocity_mps: tuple[float, float, float]
    acceleration_mps2: tuple[float, float, float]
    """Luni-solar part only."""
    frequency_channel: int


class Ephemeris(Message, frozen=True, kw_only=True):
    """Broadcast orbit and clock of one satellite.

    `t_ns` is the transmission time when known, else the reference time. Reference times
    are on the GPS time scale for every system (BeiDou +14 s, GLONASS + leap seconds
    applied on reading).
    """

    satellite: Satellite
    gps_week: int
    """Week of `toe_s`."""
    toe_s: float
    """Reference time of the orbit, time of week [s]."""
    toc_s: float
    """Reference time of the clock, seconds of the same `gps_week` (may leave [0, 604800))."""
    clock_bias_s: float
    """GLONASS: -TauN is stored, so that the sign agrees with the other systems."""
    clock_drift: float
    """[s/s]; GLONASS: +GammaN."""
    clock_drift_rate_per_s: float = 0.0
    group_delay_s: float = 0.0
    """TGD (GPS, QZSS), BGD E5b/E1 or E5a/E1 (Galileo), TGD1 (BeiDou); 0 for GLONASS."""
    issue: int = 0
    """IODE, IODnav or AODE; GLONASS: tb index."""
    healthy: bool
    accuracy_m: float | None = None
    """User range accuracy, upper edge [m]."""
    fit_interval_s: float
    """The ephemeris may be used while |t - toe| is at most this."""
    orbit: KeplerOrbit | StateVectorOrbit


class Ionosphere(Message, frozen=True, kw_only=True):
    """Klobuchar coefficients as broadcast (IS-GPS-200, 20.3.3.5.1.7)."""

    alpha: tuple[float, float, float, float]
    """[s, s/semicircle, s/semicircle^2, s/semicircle^3]."""
    beta: tuple[float, float, float, float]


class SatelliteVerdict(Part, frozen=True, kw_only=True):
    """What is believed of one satellite's pseudorange at one epoch, and why."""

    satellite: Satellite
    used: bool
    """It took part in the primary fix."""
    flagged: bool
    """The detector holds it for multipath."""
    multipath_probability: Annotated[float, Meta(ge=0.0, le=1.0)] | None = None
    reason: str
    """In words: why it was flagged or left out, or 'clean'."""
    elevation_rad: float | None = None
    azimuth_rad: float | None = None
    cn0_dbhz: float | None = None
    change_m: float | None = None
    """The paper's Pc, scaled to its nominal interval [m]; None until it can be computed."""
    threshold_m: float | None = None
    residual_m: float | None = None
    adjusted_by_m: float | None = None
    """Substituted minus measured pseudorange, where one was substituted."""
    adjusted_rate_by_mps: float | None = None
    """Substituted minus measured range rate (by Doppler), where one was substituted; the carrier phase goes with it."""
    correction_age_s: float | None = None
    """Age of the reference station's correction, where it was corrected."""


class Verdicts(Message, frozen=True, kw_only=True):
    """Verdict of every satellite of one epoch."""

    gps_week: int
    tow_s: float
    satellites: tuple[SatelliteVerdict, ...]


class Fix(Message, frozen=True, kw_only=True):
    """A position of a receiver's antenna, or the reason why there is none (WGS 84)."""

    gps_week: int
    tow_s: float
    method: Method
    status: FixStatus
    reason: str = ""
    """Why there is no fix, or what is special about it; empty when all is well."""
    lat_deg: float | None = None
    lon_deg: float | None = None
    h_m: float | None = None
    """Ellipsoidal height [m]."""
    ve_mps: float | None = None
    vn_mps: float | None = None
    vu_mps: float | None = None
    clock_bias_m: float | None = None
    satellites_used: int
    satellites_flagged: int
    satellites_corrected: int = 0
    """Of those used, how many by a reference station."""
    sigma_horizontal_m: Metres | None = None
    """One standard deviation of the horizontal position by the weights and the residuals; not a bound."""
    bound_m: Metres | None = None
    """Horizontal error that the method vouches for; None when it vouches for none."""
    chainage_m: float | None = None
    """Kilometrage on the line, where one is known."""
    chainage_bound_m: Metres | None = None
    """Error of the chainage that the method vouches for; None when it vouches for none."""
    speed_along_mps: float | None = None
    """Speed along the line, positive towards the end of its axis."""
    hdop: float | None = None


class FrontEnd(Message, frozen=True, kw_only=True):
    """Where the train's front end is by its antennas together, and whether they agree."""

    devices: tuple[str, ...]
    """Antennas with a fix and a bound at this time."""
    agreement: Literal["agree", "disagree", "unknown"]
    """`unknown` while fewer than two antennas can be compared."""
    reason: str
    chainage_m: float | None = None
    """Of the front end; None without a line, or while the direction of the front is not known."""
    chainage_bound_m: Metres | None = None
    """Error that is vouched for. Covers every antenna's claim when they disagree."""
    facing: Literal["up", "down"] | None = None
    """`up`: the front end looks towards rising chainage."""
    difference_m: Metres | None = None
    """By how much the antennas' distance is not what it is on the train."""
    allowed_m: Metres | None = None
    """How much of that their bounds explain."""


class OwnPosition(Message, frozen=True, kw_only=True):
    """What a receiver itself says about its position (WGS 84); for receivers that measure nothing else, the best."""

    protocol: Literal["nmea", "ubx"]
    status: FixStatus
    """`predicted` when the receiver says that it estimates by dead reckoning."""
    mode: OwnMode
    lat_deg: float | None = None
    lon_deg: float | None = None
    h_m: float | None = None
    """Ellipsoidal height [m]."""
    ve_mps: float | None = None
    vn_mps: float | None = None
    vu_mps: float | None = None
    satellites_used: int | None = None
    hdop: float | None = None
    sigma_horizontal_m: Metres | None = None
    """One standard deviation of the horizontal position, as the receiver says."""
    sigma_vertical_m: Metres | None = None
    correction_age_s: float | None = None
    """Age of the corrections that it uses."""


class SignalDifference(Part, frozen=True, kw_only=True):
    """How the correction of a further signal of a satellite differs."""

    signal: str
    difference_m: float
    """To be added to the satellite's correction for this signal; the same constant may be missing from all of a
    constellation."""


class SatelliteCorrection(Part, frozen=True, kw_only=True):
    """What a reference station found to be wrong with one satellite's pseudorange."""

    satellite: Satellite
    signal: str
    issue: int
    """Issue of the ephemeris that it holds for; as in Ephemeris."""
    toe_week: int
    toe_s: float
    """Reference time of that ephemeris."""
    correction_m: float
    """To be added to the pseudorange. Holds the air above the station: of models add at most the places' difference."""
    rate_mps: float
    """Change of the correction [m/s]."""
    sigma_m: Metres
    elevation_rad: float
    """Above the station's horizon."""
    smoothed_s: float
    """Time over which the carrier has smoothed it; 0 for the code alone."""
    others: tuple[SignalDifference, ...] = ()
    """Further signals of the satellite."""


class SatelliteRefusal(Part, frozen=True, kw_only=True):
    """A satellite without a correction, and why."""

    satellite: Satellite
    reason: str


class Corrections(Message, frozen=True, kw_only=True):
    """Pseudorange corrections of one reference station at one instant.

    The correction at a time t is `correction_m + rate_mps * (t - t_ns)`. The station's clock is
    taken out for each constellation by itself.
    """

    station: str
    gps_week: int
    tow_s: float
    lat_deg: float
    lon_deg: float
    h_m: float
    """Antenna of the station (WGS 84)."""
    satellites: tuple[SatelliteCorrection, ...]
    refused: tuple[SatelliteRefusal, ...] = ()
