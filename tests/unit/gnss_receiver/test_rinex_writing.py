"""Files written and read back: the same figures, the same words."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, Epoch, Ionosphere, KeplerOrbit, StateVectorOrbit
from schemas.gnss_time import WEEK_S, gps_from_unix_ns, unix_ns_from_gps
from services.gnss_receiver.observations import SYSTEMS, Navigation, Observations, observations_of, satellite_code
from services.gnss_receiver.rinex_navigation_file import read_navigation, write_navigation
from services.gnss_receiver.rinex_observation_file import read_observations, write_observations
from services.gnss_receiver.rinex_observation_text import RecordingHeader
from tests.unit.gnss_receiver.samples import (
    SATELLITES,
    epoch_3,
    header_3,
    header_line,
    rows_of,
    text_of,
)

# Hatanaka's programs want a complete header.
_MORE = [
    header_line("kirotei", "PGM / RUN BY / DATE"),
    header_line("unknown", "MARKER NAME"),
]
THREE = text_of(header_3()[:1], _MORE, header_3()[1:], epoch_3(0), epoch_3(1))


def figures(low_milli: int, high_milli: int) -> st.SearchStrategy[float]:
    """Figures that F14.3 can hold, and none; never zero, which is none in RINEX."""
    return st.integers(low_milli, high_milli).map(lambda milli: milli / 1000 if milli else math.nan) | st.just(math.nan)


SIGNALS = {"G": ("1C", "1W", "5Q"), "R": ("1C", "2C"), "E": ("1C",), "C": ("2I",), "J": ("1C",), "S": ("1C",)}


@st.composite
def epochs(draw: st.DrawFn) -> list[Epoch]:
    """Epochs as a receiver makes them: satellites in any order, signals by name, something measured in each."""
    made = []
    times = draw(st.lists(st.integers(0, WEEK_S * 10_000_000 - 1), min_size=1, max_size=4))
    names = [f"{system}{number:02d}" for system in SIGNALS for number in (1, 7, 32)]
    for ticks in times:
        satellites = draw(st.lists(st.sampled_from(names), unique=True, max_size=6))
        rows = [(name, signal) for name in satellites for signal in SIGNALS[name[0]] if draw(st.booleans())]
        count = len(rows)

        def column(strategy: st.SearchStrategy[float], count: int = count) -> NDArray[np.float64]:
            return np.array(draw(st.lists(strategy, min_size=count, max_size=count)), np.float64)

        pseudorange_m = column(st.integers(1, 10**13 - 1).map(lambda milli: milli / 1000))
        phase = column(figures(-(10**12) + 1, 10**13 - 1))
        doppler, cn0 = column(figures(-(10**8), 10**8)), column(figures(1, 60_000))
        lost = np.array(draw(st.lists(st.integers(0, 7), min_size=count, max_size=count)), np.uint8)
        week = draw(st.sampled_from((1900, 2300)))
        made.append(
            Epoch(
                t_ns=unix_ns_from_gps(week, ticks / 1e7),
                gps_week=week,
                tow_s=ticks / 1e7,
                satellites=tuple(name for name, _ in rows),
                signals=tuple(signal for _, signal in rows),
                pseudorange_m=pseudorange_m,
                carrier_phase_cycles=phase,
                doppler_hz=doppler,
                cn0_dbhz=cn0,
                lock_lost=lost,
            )
        )
    return made


def same(left: Epoch, right: Epoch) -> bool:
    return all(
        np.array_equal(getattr(left, name), getattr(right, name), equal_nan=name not in {"satellites", "signals"})
        for name in Epoch.__struct_fields__
        if name != "t_ns"
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # each example has its own file
@given(made=epochs())
def test_observations_come_back_as_they_were_written(tmp_path: Path, made: list[Epoch]) -> None:
    path = tmp_path / "written.rnx"
    if not any(epoch.satellites for epoch in made):
        with pytest.raises(ValueError, match="no measurements to write"):
            write_observations(path, made)
        return
    write_observations(path, made)
    back = read_observations(path)
    assert back.issues == ()
    assert len(back) == len(made)
    assert all(same(back.epoch(index), epoch) for index, epoch in enumerate(made))
    # The same once more, from columns: the bytes are the same.
    first = path.read_bytes()
    write_observations(path, back)
    assert path.read_bytes() == first


def test_the_header_of_a_written_file(tmp_path: Path) -> None:
    path = tmp_path / "header.rnx"
    observations = small_recording(tmp_path)
    header = RecordingHeader(
        marker="T1 front",
        receiver="simulated",
        approximate_position_m=(-2845905.3086, 4661546.1328, 3283136.1093),
        interval_s=0.2,
        glonass_channels={slot: slot % 7 - 7 for slot in range(1, 11)},
        comments=("seed 7",),
    )
    write_observations(path, observations, header)
    lines = path.read_text("ascii").splitlines()
    assert all(len(line) <= 80 for line in lines[: lines.index(header_line("", "END OF HEADER"))])
    for expected_line in (
        header_line("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        header_line("seed 7", "COMMENT"),
        header_line("T1 front", "MARKER NAME"),
        header_line(" -2845905.3086  4661546.1328  3283136.1093", "APPROX POSITION XYZ"),
        header_line("G    4 C1C L1C D1C S1C", "SYS / # / OBS TYPES"),
        header_line("     0.200", "INTERVAL"),
        header_line("  2016     6     6    11    10   41.7000000     GPS", "TIME OF FIRST OBS"),
        header_line(" 10 R01 -6 R02 -5 R03 -4 R04 -3 R05 -2 R06 -1 R07 -7 R08 -6", "GLONASS SLOT / FRQ #"),
        header_line("    R09 -5 R10 -4", "GLONASS SLOT / FRQ #"),
    ):
        assert expected_line in lines


def small_recording(folder: Path) -> Observations:
    path = folder / "three.rnx"
    path.write_bytes(THREE)
    return read_observations(path)


def test_what_rinex_cannot_hold_is_refused_and_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "old.rnx"
    path.write_text("as it was")
    observations = small_recording(tmp_path)
    large = replace(observations, carrier_phase_cycles=observations.carrier_phase_cycles * 1e6)
    with pytest.raises(ValueError, match=r"L1C of G12 is 1\.05e\+14, too large for RINEX"):
        write_observations(path, large)
    torn = replace(observations, satellite=np.array([112, 20, 112, 19, 112, 20, 205, 19], np.uint16))
    with pytest.raises(ValueError, match="epoch 0: R12 comes back after another satellite"):
        write_observations(path, torn)
    assert path.read_text() == "as it was"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["old.rnx", "three.rnx"]


def test_columns_of_epochs_are_those_of_the_file(tmp_path: Path) -> None:
    observations = small_recording(tmp_path)
    again = observations_of(observations.epoch(index) for index in range(len(observations)))
    assert rows_of(again) == rows_of(observations)
    assert len(observations_of([])) == 0


@pytest.mark.parametrize("name", SATELLITES)
def test_satellite_numbers(name: str) -> None:
    assert satellite_code(name) // 100 == SYSTEMS.index(name[0])


def twelve_decimals(low: float, high: float) -> st.SearchStrategy[float]:
    """Figures as a navigation file holds them: thirteen digits, or zero."""
    return st.floats(low, high).map(lambda value: float(f"{value:.12E}") if abs(value) > 1e-90 else 0.0)


@st.composite
def ephemerides(draw: st.DrawFn) -> Ephemeris:
    """Ephemerides that a RINEX file can hold whole."""
    system = draw(st.sampled_from("GECJ"))
    week, toe_s = draw(st.integers(1400, 2400)), float(16 * draw(st.integers(0, WEEK_S // 16 - 1)))
    sent_s = toe_s - draw(st.integers(-3600, 7200))
    sent = divmod(week * WEEK_S + sent_s, WEEK_S)
    small = twelve_decimals(-1e-3, 1e-3)
    angle = twelve_decimals(-math.pi, math.pi)
    return Ephemeris(
        t_ns=unix_ns_from_gps(int(sent[0]), sent[1]),
        satellite=f"{system}{draw(st.integers(1, 32)):02d}",
        gps_week=week,
        toe_s=toe_s,
        toc_s=toe_s + 16 * draw(st.integers(-100, 100)),
        clock_bias_s=draw(small),
        clock_drift=draw(small),
        clock_drift_rate_per_s=draw(small),
        group_delay_s=draw(small),
        issue=draw(st.integers(0, 255)),
        healthy=draw(st.booleans()),
        accuracy_m=draw(st.none() | st.just(3.12)),
        fit_interval_s={"G": draw(st.sampled_from((7200.0, 10800.0))), "E": 14400.0}.get(system, 7200.0),
        orbit=KeplerOrbit(
            sqrt_a=draw(twelve_decimals(5000, 7000)),
            eccentricity=draw(twelve_decimals(0, 0.2)),
            m0_rad=draw(angle),
            delta_n_radps=draw(small),
            omega0_rad=draw(angle),
            omega_dot_radps=draw(small),
            omega_rad=draw(angle),
            i0_rad=draw(angle),
            i_dot_radps=draw(small),
            cuc_rad=draw(small),
            cus_rad=draw(small),
            crc_m=draw(twelve_decimals(-1000, 1000)),
            crs_m=draw(twelve_decimals(-1000, 1000)),
            cic_rad=draw(small),
            cis_rad=draw(small),
        ),
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # each example has its own file
@given(made=ephemerides())
def test_ephemerides_come_back_as_they_were_written(tmp_path: Path, made: Ephemeris) -> None:
    path = tmp_path / "written.nav"
    navigation = Navigation((made,), Ionosphere(t_ns=0, alpha=(1e-9, 0.0, -5.96e-8, 0.0), beta=(8e4, -1e5, 0.0, 0.0)))
    write_navigation(path, navigation)
    assert read_navigation([path]) == navigation


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # each example has its own file
@given(
    unix_quarters=st.integers(1_600_000, 1_950_000),
    position_km=st.tuples(*[twelve_decimals(13_000, 15_500)] * 3),
    velocity_kmps=st.tuples(*[twelve_decimals(-4, 4)] * 3),
    channel=st.integers(-7, 6),
)
def test_glonass_states_come_back_as_they_were_written(
    tmp_path: Path,
    unix_quarters: int,
    position_km: tuple[float, float, float],
    velocity_kmps: tuple[float, float, float],
    channel: int,
) -> None:
    week, toe_s = gps_from_unix_ns(unix_quarters * 900 * 10**9)
    made = Ephemeris(
        t_ns=(unix_quarters * 900 - 870) * 10**9,
        satellite="R07",
        gps_week=week,
        toe_s=toe_s,
        toc_s=toe_s,
        clock_bias_s=1.25e-5,
        clock_drift=-1e-12,
        issue=(unix_quarters + 12) % 96,
        healthy=True,
        fit_interval_s=1800.0,
        orbit=StateVectorOrbit(
            position_m=tuple(1000 * part for part in position_km),  # type: ignore[arg-type]  # three of three
            velocity_mps=tuple(1000 * part for part in velocity_kmps),  # type: ignore[arg-type]  # three of three
            acceleration_mps2=(0.0, 1e-6, 0.0),
            frequency_channel=channel,
        ),
    )
    path = tmp_path / "written.nav"
    write_navigation(path, Navigation((made,)))
    (back,) = read_navigation([path]).ephemerides
    assert back == msgspec.structs.replace(made, orbit=back.orbit)
    assert isinstance(back.orbit, StateVectorOrbit)
    assert isinstance(made.orbit, StateVectorOrbit)
    # Kilometres to metres and back rounds in the last place.
    assert back.orbit.position_m == pytest.approx(made.orbit.position_m, rel=1e-15)
    assert back.orbit.velocity_mps == pytest.approx(made.orbit.velocity_mps, rel=1e-15)
    assert back.orbit.frequency_channel == channel
