"""Logs as files, and the command that analyses them: what is wrong is named."""

from __future__ import annotations

import csv
import json
from datetime import UTC, datetime
from pathlib import Path

import duckdb
import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from services.run_history.command import app
from services.run_history.fixes import RunLog
from services.run_history.gpx_file import GpxError
from services.run_history.log_analysis import Job, analysed_runs
from services.run_history.nmea_file import NmeaLogError
from services.run_history.runs_log_file import RunsLogError, read_runs
from services.run_history.runs_table_file import read_rows
from services.run_history.timetable_file import TimetableError, read_timetable
from services.run_history.vehicle_file import VehicleFileError, read_vehicle
from tests.unit.run_history.made_runs import LINE, TRAIN, made_run

COLUMNS = ("t_unix_s", "lat_deg", "lon_deg", "speed_mps", "run_id")


def write_csv(path: Path, *runs: RunLog) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for run in runs:
            for row in zip(run.t_unix_s, run.lat_deg, run.lon_deg, run.speed_mps, strict=True):
                writer.writerow([*(repr(float(one)) for one in row), run.run_id])
    return path


def write_gpx(path: Path, run: RunLog, *, speed: bool) -> Path:
    points = []
    for t, lat, lon, mps in zip(run.t_unix_s, run.lat_deg, run.lon_deg, run.speed_mps, strict=True):
        moment = datetime.fromtimestamp(float(t), UTC).isoformat().replace("+00:00", "Z")
        told = f"<extensions><speed>{mps:.4f}</speed></extensions>" if speed else ""
        points.append(f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"><time>{moment}</time>{told}</trkpt>')
    path.write_text(
        '<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1"><trk><name>one</name>'
        f"<trkseg>{''.join(points)}</trkseg></trk></gpx>",
        "utf-8",
    )
    return path


def write_nmea(path: Path, run: RunLog) -> Path:
    lines = []
    for t, lat, lon, mps in zip(run.t_unix_s, run.lat_deg, run.lon_deg, run.speed_mps, strict=True):
        moment = datetime.fromtimestamp(float(t), UTC)
        body = (
            f"GPRMC,{moment:%H%M%S}.00,A,{int(lat):02d}{lat % 1 * 60:09.6f},N,{int(lon):03d}{lon % 1 * 60:09.6f},E,"
            f"{mps * 3600 / 1852:.3f},0.0,{moment:%d%m%y},,,A"
        )
        sum_ = 0
        for letter in body:
            sum_ ^= ord(letter)
        lines.append(f"${body}*{sum_:02X}\r\n")
    lines.insert(3, "$GPRMC,damaged*00\r\n")
    path.write_text("".join(lines), "ascii")
    return path


def same(one: RunLog, other: RunLog, place_deg: float, speed_mps: float) -> None:
    assert one.t_unix_s == pytest.approx(other.t_unix_s, abs=1e-3)
    assert one.lat_deg == pytest.approx(other.lat_deg, abs=place_deg)
    assert one.lon_deg == pytest.approx(other.lon_deg, abs=place_deg)
    assert one.speed_mps == pytest.approx(other.speed_mps, abs=speed_mps)


def test_a_csv_and_a_parquet_of_several_runs_come_back(tmp_path: Path) -> None:
    runs = (made_run(run_id="a"), made_run(run_id="b", up=False, zero_s=1.7e9 + 5000.0))
    table = write_csv(tmp_path / "runs.csv", runs[1], runs[0])
    parquet = tmp_path / "runs.parquet"
    duckdb.connect().execute(f"COPY (SELECT * FROM '{table}') TO '{parquet}'")  # noqa: S608 - a test's own path
    for path in (table, parquet):
        back = list(read_runs(path))
        assert [one.run_id for one in back] == ["a", "b"]
        for one, other in zip(back, runs, strict=True):
            same(one, other, 0.0, 0.0)


def test_gpx_and_nmea_in_a_folder_come_back(tmp_path: Path) -> None:
    run = made_run()
    write_gpx(tmp_path / "1.gpx", run, speed=True)
    write_nmea(tmp_path / "2.nmea", run)
    write_gpx(tmp_path / "3.gpx", run, speed=False)
    told, nmea, silent = read_runs(tmp_path)
    same(told, run, 1e-8, 1e-4)
    same(nmea, run, 1e-7, 1e-3)
    assert np.isnan(silent.speed_mps).all()


@pytest.mark.parametrize(
    ("name", "text", "error", "words"),
    [
        ("a.csv", "t_unix_s,lat_deg,lon_deg\n", RunsLogError, "no rows"),
        ("a.csv", "", RunsLogError, "a.csv"),
        ("a.csv", "time,lat,lon,speed_kmh\n1,2,3,4\n", RunsLogError, "speed_kmh looks like speed_mps .divide by 3.6"),
        ("a.csv", "t_unix_s,lat_deg,lon_deg,speed\n1,2,3,4\n", RunsLogError, "no column speed_mps.*unit is not said"),
        ("a.csv", "t_unix_s,lat_deg,lon_deg,speed_kmh\n1,2,3,4\n", RunsLogError, "divide by 3.6"),
        ("a.gpx", "<gpx><trk><name>x</name></trk></gpx>", GpxError, "no point"),
        ("a.gpx", "", GpxError, "a.gpx:1"),
        ("a.gpx", "<gpx></gpx>", GpxError, "no track"),
        ("a.gpx", "<!DOCTYPE x><gpx></gpx>", GpxError, "document type"),
        ("a.nmea", "hello\n", NmeaLogError, "no usable RMC"),
        ("a.doc", "hello\n", RunsLogError, "is none of"),
    ],
)
def test_files_that_are_no_logs_are_named(
    tmp_path: Path, name: str, text: str, error: type[Exception], words: str
) -> None:
    path = tmp_path / name
    path.write_text(text, "utf-8")
    with pytest.raises(error, match=words):
        list(read_runs(path))


def test_an_empty_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunsLogError, match="no file here ends in"):
        list(read_runs(tmp_path))


def test_processes_change_nothing() -> None:
    runs = [made_run(run_id=str(k)) for k in range(2)]
    job = Job(LINE, TRAIN, {("A", "B"): 200.0})
    alone = list(analysed_runs(runs, job))
    assert alone == list(analysed_runs(runs, job, 2))
    assert alone[0].rows[0].scheduled_s == 200.0


def test_the_command_from_gpx_files_to_rows(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    write_gpx(logs / "1.gpx", made_run(), speed=True)
    write_gpx(logs / "2.gpx", made_run(up=False), speed=False)
    line, vehicle, out = tmp_path / "line.json", tmp_path / "vehicle.toml", tmp_path / "runs.csv"
    line.write_bytes(msgspec.json.encode(LINE))
    vehicle.write_text('name = "made"\nmass_t = 100\n', "utf-8")
    told = CliRunner().invoke(
        app,
        ["analyse", "--log", str(logs), "--line", str(line), "--vehicle", str(vehicle), "--out", str(out), "--json"],
    )
    assert told.exit_code == 0, told.output
    summary = json.loads(told.stdout)
    assert (summary["runs"], summary["legs"]) == (2, 4)
    assert any("derived from places" in note for note in summary["notes"])
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["direction"] for row in rows] == ["up", "up", "down", "down"]
    assert all(float(row["energy_kwh"]) > 0.0 for row in rows)


def test_vehicle_and_timetable_files_name_what_is_wrong(tmp_path: Path) -> None:
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text('name = "x"\nmass_t = -3\n', "utf-8")
    with pytest.raises(VehicleFileError, match="mass_t"):
        read_vehicle(vehicle)
    vehicle.write_text('name = "x"\nmass_t = 3\nmass_kg = 3000\n', "utf-8")
    with pytest.raises(VehicleFileError, match="mass_kg"):
        read_vehicle(vehicle)
    table = tmp_path / "times.csv"
    table.write_text("from,to,running_time_s\nA,B,soon\n", "utf-8")
    with pytest.raises(TimetableError, match=r"times\.csv:2.*soon"):
        read_timetable(table)


def test_the_demo_vehicle_serves_and_rows_come_back_with_what_stands_apart(tmp_path: Path) -> None:
    log, line, out = write_csv(tmp_path / "log.csv", made_run()), tmp_path / "line.json", tmp_path / "runs.csv"
    line.write_bytes(msgspec.json.encode(LINE))
    told = CliRunner().invoke(
        app, ["analyse", "--log", str(log), "--line", str(line), "--vehicle", "demo", "--out", str(out)]
    )
    assert told.exit_code == 0, told.output
    first = read_rows(out)[0]
    assert first.regenerated_kwh is not None
    assert first.regenerated_kwh > 0.0
    assert first.regenerated_sigma_kwh is not None
    assert first.auxiliaries_kwh is not None
    assert first.auxiliaries_kwh > 0.0
    assert first.energy_noise_kwh is not None
    assert 0.0 <= first.energy_noise_kwh < first.energy_kwh


def test_a_table_of_an_earlier_version_is_read_without_what_stands_apart(tmp_path: Path) -> None:
    plain = (
        "run_id,from,to,departure,arrival,running_time_s,energy_kwh,energy_uncertainty,energy_normalised,series,"
        "direction,scheduled_s,window_s,quality,excluded_because\n"
        "r,A,B,2026-01-31T10:00:00Z,2026-01-31T10:03:00Z,180.0,12.0,1.0,,s,up,,,1.00,\n"
    )
    (tmp_path / "runs.csv").write_text(plain, "utf-8")
    (row,) = read_rows(tmp_path / "runs.csv")
    assert (row.regenerated_kwh, row.auxiliaries_kwh, row.energy_noise_kwh) == (None, None, None)
