"""Real RINEX files against a reading of their lines one by one, with nothing but slices and float().

KIROTEI_FIELD_DATA names the folder that holds gnss/.
"""

from __future__ import annotations

import gzip
import math
import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import hatanaka
import numpy as np
import pytest

from schemas.gnss import KeplerOrbit, StateVectorOrbit
from services.gnss_receiver.observations import Observations, satellite_name
from services.gnss_receiver.rinex_navigation_file import read_navigation, write_navigation
from services.gnss_receiver.rinex_observation_file import read_observations, write_observations

ROOT = Path(os.environ.get("KIROTEI_FIELD_DATA", "/nonexistent")) / "gnss"
pytestmark = pytest.mark.skipif(not ROOT.is_dir(), reason="KIROTEI_FIELD_DATA does not name a folder with gnss/")

RINEX_3 = (
    "boulder_4hz/rover.obs",
    "shanghai_dgps/rover.obs",
    "shanghai_dgps/base.obs",
    "static_dgps/rover.obs",
    "static_dgps/base.obs",
)
RINEX_2 = ("berlin_5hz/rover.obs",)
NAVIGATION = (
    "berlin_5hz/nav_gps.16n",
    "berlin_5hz/nav_glo.16g",
    "berlin_5hz/nav_mixed.rnx",
    "boulder_4hz/nav.rnx",
    "shanghai_dgps/nav.rnx",
    "static_dgps/nav.rnx",
)
NO_QUARTER = {"berlin_5hz/nav_glo.16g": 6}
"""GLONASS records of a station that gave GPS time for UTC."""
COLUMNS = {"C": "pseudorange_m", "L": "carrier_phase_cycles", "D": "doppler_hz", "S": "cn0_dbhz"}
Measured = dict[tuple[str, str, str], float]
"""By satellite, signal and column."""


def text_lines(name: str) -> list[str]:
    return (ROOT / name).read_text("ascii", errors="replace").splitlines()


def seconds_of_day(hour: str, minute: str, second: str) -> float:
    return int(hour) * 3600 + int(minute) * 60 + float(second)


def fields_of(line: str, codes: list[str], start: int) -> Iterator[tuple[str, float]]:
    for index, code in enumerate(codes):
        text = line[start + 16 * index : start + 16 * index + 14]
        if text.strip() and float(text) != 0.0:
            yield code, float(text)


def epochs_of_rinex_3(name: str) -> Iterator[tuple[float, Measured]]:
    """Seconds of the day and measurements of every epoch."""
    lines = text_lines(name)
    codes: dict[str, list[str]] = {}
    system = ""
    index = 0
    while "END OF HEADER" not in lines[index]:
        if "SYS / # / OBS TYPES" in lines[index]:
            system = lines[index][0].strip() or system
            codes.setdefault(system, []).extend(lines[index][7:60].split())
        index += 1
    index += 1
    while index < len(lines):
        head = lines[index].split()
        measured: Measured = {}
        for line in lines[index + 1 : index + 1 + int(head[8])]:
            for code, value in fields_of(line, codes[line[0]], 3):
                if code[0] in COLUMNS:
                    measured[line[:3], code[1:], COLUMNS[code[0]]] = value
        yield seconds_of_day(*head[4:7]), measured
        index += 1 + int(head[8])


def epochs_of_berlin() -> Iterator[tuple[float, Measured]]:
    """The same of the one RINEX 2 file: four observables, so one line per satellite."""
    lines = text_lines(RINEX_2[0])
    index = next(at for at, line in enumerate(lines) if line[60:].startswith("END OF HEADER")) + 1
    while index < len(lines):
        head = lines[index]
        count = int(head[29:32])
        names = head[32:68].rstrip()
        index += 1
        while len(names) < 3 * count:
            names += lines[index].strip()
            index += 1
        measured: Measured = {}
        for place in range(count):
            satellite = names[3 * place : 3 * place + 3]
            for code, value in fields_of(lines[index + place], ["C", "L", "S", "D"], 0):
                measured[satellite, "1C", COLUMNS[code]] = value
        yield seconds_of_day(*head[:26].split()[3:6]), measured
        index += count


def measured_in(observations: Observations, index: int) -> Measured:
    found: Measured = {}
    for row in range(int(observations.first_row[index]), int(observations.first_row[index + 1])):
        satellite = satellite_name(int(observations.satellite[row]))
        for column in COLUMNS.values():
            value = float(getattr(observations, column)[row])
            if not math.isnan(value):
                found[satellite, observations.signals[int(observations.signal[row])], column] = value
    return found


@pytest.mark.parametrize("name", [*RINEX_2, *RINEX_3])
def test_every_figure_of_an_observation_file(name: str) -> None:
    observations = read_observations(ROOT / name)
    assert observations.issues == ()
    epochs = list(epochs_of_berlin() if name in RINEX_2 else epochs_of_rinex_3(name))
    assert len(observations) == len(epochs)
    for index, (day_s, measured) in enumerate(epochs):
        # Whole days apart, but for the last digit that the addition of hours and seconds rounds.
        days = (float(observations.tow_s[index]) - day_s) / 86_400
        assert days == pytest.approx(round(days), abs=1e-12)
        assert measured_in(observations, index) == measured


@pytest.mark.parametrize(
    ("name", "week", "tow_s"),
    [
        ("berlin_5hz/rover.obs", 1900, 126641.7),
        ("boulder_4hz/rover.obs", 2381, 408639.748),
        ("shanghai_dgps/rover.obs", 2262, 455618.0),
        ("static_dgps/rover.obs", 2320, 116400.0),
    ],
)
def test_first_epochs(name: str, week: int, tow_s: float) -> None:
    observations = read_observations(ROOT / name)
    assert (int(observations.gps_week[0]), float(observations.tow_s[0])) == (week, tow_s)


@pytest.mark.parametrize("name", ["berlin_5hz/rover.obs", "static_dgps/rover.obs"])
def test_compressed_files_say_the_same(name: str, tmp_path: Path) -> None:
    plain = (ROOT / name).read_bytes()
    path = tmp_path / "compressed"
    expected = read_observations(ROOT / name)
    for packed in (hatanaka.rnx2crx(plain), gzip.compress(hatanaka.rnx2crx(plain)), gzip.compress(plain, 1)):
        path.write_bytes(packed)
        assert_same(read_observations(path), expected)


def assert_same(left: Observations, right: Observations) -> None:
    assert left.issues == right.issues == ()
    assert left.signals == right.signals
    for column in ("gps_week", "tow_s", "first_row", "satellite", "signal", "lock_lost", *COLUMNS.values()):
        np.testing.assert_array_equal(getattr(left, column), getattr(right, column))


@pytest.mark.parametrize("name", ["berlin_5hz/rover.obs", "boulder_4hz/rover.obs"])
def test_writing_keeps_every_figure(name: str, tmp_path: Path) -> None:
    observations = read_observations(ROOT / name)
    write_observations(tmp_path / "written.rnx", observations)
    assert_same(read_observations(tmp_path / "written.rnx"), observations)


def record_starts(name: str) -> list[tuple[str, list[str]]]:
    """Satellite and lines of every record."""
    lines = text_lines(name)
    body = next(at for at, line in enumerate(lines) if "END OF HEADER" in line) + 1
    system = {"n": "G", "g": "R"}.get(name[-1]) if name[-2].isdigit() else ""
    starts = [at for at in range(body, len(lines)) if re.match(r"[A-Z]\d\d |[ \d]\d \d\d ", lines[at])]
    records = []
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        first = lines[start]
        satellite = first[:3] if not system else f"{system}{int(first[:2]):02d}"
        records.append((satellite, lines[start:end]))
    return records


@pytest.mark.parametrize("name", NAVIGATION)
def test_every_record_of_a_navigation_file(name: str) -> None:
    navigation = read_navigation([ROOT / name])
    assert ["behind a quarter" in issue.text for issue in navigation.issues] == [True] * NO_QUARTER.get(name, 0)
    indent = 4 if name.endswith("rnx") else 3

    def number(line: str, column: int) -> float:
        return float(line[indent + 19 * column : indent + 19 * (column + 1)].lower().replace("d", "e"))

    wanted: Counter[str] = Counter()
    seen = set()
    for satellite, lines in record_starts(name):
        fnav = satellite[0] == "E" and int(number(lines[5], 1)) & 1 << 8
        # One record of an orbit: satellite, time and, for those with Keplerian elements, issue of data.
        key = (
            (satellite, number(lines[3], 0), number(lines[1], 0))
            if satellite[0] != "R"
            else (satellite, lines[0][3:22])
        )
        no_quarter = satellite[0] == "R" and float(lines[0][17:22] if indent == 3 else lines[0][20:23]) != 0.0
        if satellite[0] != "S" and not fnav and not no_quarter and key not in seen:
            seen.add(key)
            wanted[satellite] += 1
    assert Counter(ephemeris.satellite for ephemeris in navigation.ephemerides) == wanted


def test_figures_of_navigation_files() -> None:
    gps = next(e for e in read_navigation([ROOT / "berlin_5hz/nav_gps.16n"]).ephemerides if e.satellite == "G02")
    assert isinstance(gps.orbit, KeplerOrbit)
    assert (gps.orbit.sqrt_a, gps.clock_bias_s, gps.group_delay_s) == (
        5153.57442093,
        0.000587341841310,
        -0.200234353542e-07,
    )
    assert (gps.gps_week, gps.toe_s, gps.toc_s, gps.issue, gps.healthy) == (1900, 86400.0, 86400.0, 47, True)
    sick = next(e for e in read_navigation([ROOT / "berlin_5hz/nav_gps.16n"]).ephemerides if e.satellite == "G04")
    assert not sick.healthy
    glonass = next(e for e in read_navigation([ROOT / "berlin_5hz/nav_glo.16g"]).ephemerides if e.satellite == "R02")
    assert isinstance(glonass.orbit, StateVectorOrbit)
    # 0:15 UTC on Monday, 17 leap seconds.
    assert (glonass.gps_week, glonass.toe_s, glonass.clock_bias_s) == (1900, 87317.0, 0.000194282270968)
    assert glonass.orbit.frequency_channel == -4
    static = read_navigation([ROOT / "static_dgps/nav.rnx"])
    beidou = next(e for e in static.ephemerides if e.satellite == "C01")
    assert (beidou.gps_week, beidou.toe_s, beidou.group_delay_s) == (2320, 115214.0, -4.9e-9)
    assert static.ionosphere is not None
    assert static.ionosphere.alpha == (1.8626e-08, 2.2352e-08, -1.1921e-07, -5.9605e-08)
    assert static.ionosphere.beta == (129020.0, 163840.0, -196610.0, -262140.0)
    # QZSS satellites that only say that they send no L1C/B are well.
    assert all(e.healthy for e in static.ephemerides if e.satellite[0] == "J")


def test_files_of_one_day_collapse() -> None:
    names = ("nav_gps.16n", "nav_glo.16g", "nav_mixed.rnx")
    together = read_navigation([ROOT / "berlin_5hz" / name for name in names]).ephemerides
    keys = [(e.satellite, e.gps_week, e.toe_s, e.issue) for e in together]
    assert len(keys) == len(set(keys))
    apart = [e for name in names for e in read_navigation([ROOT / "berlin_5hz" / name]).ephemerides]
    assert set(keys) == {(e.satellite, e.gps_week, e.toe_s, e.issue) for e in apart}
    assert len(keys) < len(apart)


@pytest.mark.parametrize("name", NAVIGATION)
def test_written_navigation_says_the_same(name: str, tmp_path: Path) -> None:
    navigation = read_navigation([ROOT / name])
    write_navigation(tmp_path / "written.nav", navigation)
    assert read_navigation([tmp_path / "written.nav"]) == replace(navigation, issues=())
