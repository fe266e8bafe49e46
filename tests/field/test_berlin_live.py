"""The Berlin drive live: receiver and correction as processes, fixes read by the stock zenoh command."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.wire.ports import free_port

FIELD = os.environ.get("KIROTEI_FIELD_DATA")
BERLIN = Path(FIELD or "") / "gnss" / "berlin_5hz"
BIN = Path(sys.executable).parent
WANTED = 50
METRES_PER_DEGREE = 111_320.0

pytestmark = pytest.mark.skipif(not FIELD, reason="KIROTEI_FIELD_DATA names no folder of real logs")


def profile(port: int) -> str:
    return f"""
services = ["gnss_receiver", "gnss_correction"]
[place]
line = "berlin"
kind = "train"
name = "car"
[bus]
connect = ["tcp/127.0.0.1:{port}"]
[router]
listen = ["tcp/127.0.0.1:{port}"]
[gnss_receiver]
observations = "{BERLIN / "rover.obs"}"
navigation = ["{BERLIN / "nav_gps.16n"}"]
speed = 10.0
[gnss_correction]
method = "original"
systems = "G"
"""


def test_the_zenoh_command_prints_live_fixes_of_the_drive(tmp_path: Path) -> None:
    port = free_port()
    file = tmp_path / "berlin.toml"
    file.write_text(profile(port), "utf-8")
    command = [str(BIN / "zenoh"), "--mode", "client", "--connect", f"tcp/127.0.0.1:{port}"]
    command += ["--cfg", "connect/timeout_ms:-1", "subscribe", "-k", "kirotei/v1/**", "--decoder", "kirotei"]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    fixes = []
    with (
        subprocess.Popen(
            [*command, "--line", "{key} {value}"], env=environment, stdout=subprocess.PIPE, text=True
        ) as viewer,
        subprocess.Popen(
            [str(BIN / "kirotei"), "up", "--profile", str(file)], env=environment, stdout=subprocess.DEVNULL
        ) as host,
    ):
        try:
            assert viewer.stdout is not None
            for line in viewer.stdout:
                key, _, value = line.partition(" ")
                if key == "kirotei/v1/berlin/train/car/gnss/front/fix":
                    fix = json.loads(value)
                    if fix["status"] == "fix":
                        fixes.append(fix)
                if len(fixes) == WANTED:
                    break
        finally:
            viewer.kill()
            host.terminate()
    truth = {
        round(float(row["tow_s"]), 1): (float(row["lat_deg"]), float(row["lon_deg"]))
        for row in csv.DictReader((BERLIN / "truth.csv").read_text("utf-8").splitlines())
    }
    errors_m = [
        np.hypot(fix["lat_deg"] - lat, (fix["lon_deg"] - lon) * np.cos(np.radians(lat))) * METRES_PER_DEGREE
        for fix in fixes
        for lat, lon in [truth[round(fix["tow_s"], 1)]]
    ]
    assert len(errors_m) == WANTED
    # Single-point positions among high buildings: the whole drive has 17 m mean and 82 m at most.
    assert np.mean(errors_m) < 40.0
