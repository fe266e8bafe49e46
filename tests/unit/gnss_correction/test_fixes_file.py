"""fixes.csv, verdicts.csv and what they are compared with."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from schemas.gnss import Fix, SatelliteVerdict, Verdicts
from services.gnss_correction.fixes_file import (
    FixesWriter,
    TableError,
    read_fixes,
    read_stations,
    read_truth,
)

FIX = Fix(
    t_ns=1,
    gps_week=2300,
    tow_s=216_000.2,
    method="adjust",
    status="fix",
    lat_deg=35.6812345678,
    lon_deg=139.7671234567,
    h_m=43.21,
    ve_mps=1.0,
    vn_mps=-2.5,
    vu_mps=0.0,
    satellites_used=9,
    satellites_flagged=2,
)
NONE = Fix(
    t_ns=2,
    gps_week=2300,
    tow_s=216_000.3999998,
    method="adjust",
    status="none",
    reason='3 usable of 5 satellites, "4" needed',
    satellites_used=0,
    satellites_flagged=0,
)
VERDICTS = Verdicts(
    t_ns=1,
    gps_week=2300,
    tow_s=216_000.2,
    satellites=(
        SatelliteVerdict(satellite="G05", used=True, flagged=True, multipath_probability=0.75, reason="change, much"),
        SatelliteVerdict(satellite="G07", used=False, flagged=False, reason="no ephemeris"),
    ),
)


def test_fixes_and_verdicts_are_written_as_promised(tmp_path: Path) -> None:
    fixes, verdicts = tmp_path / "fixes.csv", tmp_path / "verdicts.csv"
    writer = FixesWriter(fixes, verdicts)
    writer.write_fixes([FIX, NONE])
    writer.write_verdicts([VERDICTS])
    assert not fixes.exists(), "not before it is whole"
    writer.close()
    assert fixes.read_text("utf-8") == (
        "gps_week,tow_s,status,reason,lat_deg,lon_deg,h_m,ve_mps,vn_mps,vu_mps,"
        "satellites_used,satellites_flagged,bound_m\n"
        "2300,216000.2,fix,,35.681234568,139.767123457,43.210,1.000,-2.500,0.000,9,2,\n"
        '2300,216000.3999998,none,"3 usable of 5 satellites, ""4"" needed",,,,,,,0,0,\n'
    )
    assert verdicts.read_text("utf-8") == (
        "gps_week,tow_s,satellite,multipath_probability,flagged,reason\n"
        '2300,216000.2,G05,0.7500,1,"change, much"\n'
        "2300,216000.2,G07,,0,no ephemeris\n"
    )
    assert {path.name for path in tmp_path.iterdir()} == {"fixes.csv", "verdicts.csv"}


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    writer = FixesWriter(tmp_path / "fixes.csv", None)
    writer.write_fixes([FIX, NONE])
    writer.close()
    track = read_fixes(tmp_path / "fixes.csv", "adjust")
    assert track.fixed.tolist() == [True, False]
    assert track.lat_deg[0] == pytest.approx(35.6812345678, abs=1e-9)
    assert math.isnan(track.lat_deg[1])
    np.testing.assert_allclose(np.diff(track.t_s), 0.1999998, atol=1e-6)


def test_discarded_files_leave_nothing(tmp_path: Path) -> None:
    (tmp_path / "fixes.csv").write_text("the old one")
    writer = FixesWriter(tmp_path / "fixes.csv", tmp_path / "verdicts.csv")
    writer.write_fixes([FIX])
    writer.discard()
    assert [path.name for path in tmp_path.iterdir()] == ["fixes.csv"]
    assert (tmp_path / "fixes.csv").read_text() == "the old one"


def test_a_folder_that_is_not_there_is_said_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        FixesWriter(tmp_path / "fixes.csv", tmp_path / "nowhere" / "verdicts.csv")
    assert list(tmp_path.iterdir()) == []


TRUTH = "gps_week,tow_s,lat_deg,lon_deg,h_ell_m\n2300,1.0,35.0,135.0,40.0\n2300,2.0,35.1,135.0,41.0\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", ": no column gps_week, tow_s, lat_deg, lon_deg, h_ell_m"),
        (TRUTH.replace("lat_deg", "latitude"), "1: no column lat_deg"),
        (TRUTH.splitlines()[0], ": holds no row"),
        ("\n".join(TRUTH.splitlines()[:2]), ": holds a single point"),
        (TRUTH.replace("35.1", "north"), "3: lat_deg is 'north', which is no number"),
        (TRUTH.replace("35.1", "inf"), "3: lat_deg is inf"),
        (TRUTH.replace("35.1", ""), "3: lat_deg is '', which is no number"),
        (TRUTH.replace("2.0,35.1", "0.5,35.1"), "3: time does not rise"),
        (TRUTH + "2300,3.0\n", "4: lat_deg is '', which is no number"),
    ],
)
def test_tables_that_are_wrong_are_named_by_file_and_line(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(TableError) as error:
        read_truth(path)
    assert str(error.value).startswith(str(path))
    assert str(error.value).endswith(told)


def test_a_file_that_is_no_text_is_said(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(TableError, match="not a text file"):
        read_truth(path)


def test_truth_and_stations_are_read(tmp_path: Path) -> None:
    truth, stations = (tmp_path / name for name in ("truth.csv", "stations.csv"))
    truth.write_text("\ufeff" + TRUTH, "utf-8")
    stations.write_text("name,lat_deg,lon_deg\n大手町,35.05,135.0\n", "utf-8")
    assert read_truth(truth).at.tolist() == [2300 * 604_800 + 1.0, 2300 * 604_800 + 2.0]
    assert read_truth(truth).reference_deg == (35.0, 135.0, 40.0)
    assert read_stations(stations) == [("大手町", 35.05, 135.0)]
