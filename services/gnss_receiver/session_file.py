"""Recordings that belong together, where some of them leave open on which day they were made.

A recording of RTCM 3 may hold nothing that names the day (multiple signal messages alone, as many
bases send). What was recorded beside it then says it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from schemas.gnss_time import unix_ns_from_gps
from services.gnss_receiver.observations import Navigation, Observations
from services.gnss_receiver.recording_file import UndatedError
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations


def read_session(rover: Path, navigation: Sequence[Path]) -> tuple[Observations, Navigation]:
    """A rover's observations, and what was broadcast meanwhile; either may say the day for the other.

    Raises RinexError when a file is none, or when none of them names the day; OSError.
    """
    try:
        observations = read_observations(rover)
    except UndatedError:
        broadcast = read_navigation(navigation)
        if not broadcast.ephemerides:
            raise
        return read_observations(rover, beside_ns=broadcast.ephemerides[0].t_ns), broadcast
    return observations, read_navigation(navigation, beside_ns=began_ns(observations))


def began_ns(observations: Observations) -> int | None:
    """Time (UTC) of the first epoch; None where there is none."""
    if not len(observations):
        return None
    return unix_ns_from_gps(int(observations.gps_week[0]), float(observations.tow_s[0]))
