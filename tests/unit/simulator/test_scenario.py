from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from services.simulator.scenario import Scenario, ScenarioError, axis_of, scenario_from_toml
from services.simulator.scenario_file import embedded_scenarios, read_any_scenario, read_scenario
from services.simulator.street_scene import draw_boxes, place_name

MINIMAL = """
name = "short"
[line]
id = "x"
name = "X"
origin_lat_deg = 35.0
origin_lon_deg = 139.0
rail_height_m = 40.0
bearing_deg = 0.0
elements = [{ length_m = 1000.0 }]
stations = [{ name = "A", axis_m = 0.0 }, { name = "B", axis_m = 900.0 }]
"""


def test_everything_that_comes_with_kirotei_can_be_read() -> None:
    assert "street_canyon" in embedded_scenarios()
    for name in embedded_scenarios():
        assert read_any_scenario(name).name == name


def test_what_is_left_out_has_a_default() -> None:
    scenario = scenario_from_toml(MINIMAL)
    assert scenario.receiver.interval_s == 0.2
    assert scenario.scene.rows == ()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('name = "short"', 'nome = "short"', "nome"),
        ("bearing_deg = 0.0", "bearing_deg = 0.0\nbaering = 1", r"unknown field `baering` - at `\$\.line`"),
        ("bearing_deg = 0.0", 'bearing_deg = "north"', r"\$\.line\.bearing_deg"),
        ("bearing_deg = 0.0", "bearing_deg = nan", r"finite number is wanted - at `\$\.line\.bearing_deg`"),
        ("length_m = 1000.0", "length_m = -1.0", r"\$\.line\.elements\[0\]\.length_m"),
        ("length_m = 1000.0", "length_m = 1e9", r"too long for one plane.*\$\.line\.elements"),
        ("length_m = 1000.0", "length_m = 1000.0, radius_m = 0.0", r"no such curve - at `\$\.line\.elements`"),
        ("axis_m = 900.0", "axis_m = 1001.0", r"beyond the line's 1000.0 m - at `\$\.line\.stations\[1\]\.axis_m`"),
        ("axis_m = 900.0", "axis_m = 0.0", r"rising order - at `\$\.line\.stations\[1\]"),
        ("[line]", "[receiver]\ninterval_s = 0.0\n[line]", r"\$\.receiver\.interval_s"),
        ("[line]", "[sky]\nsystems = 'R'\n[line]", r"\$\.sky\.systems"),
        ("[line]", "[[scene.rows]]\nname = 'r'\nfrom_m = 5.0\nto_m = 5.0\n[line]", r"\$\.scene\.rows\[0\]"),
        (
            "[line]",
            "[[scene.rows]]\nname = 'r'\nfrom_m = 5.0\nto_m = 50.0\nheight_m = [9.0, 3.0]\n[line]",
            r"\(9.0, 3.0\) is no rising range within 0.0 to 1000.0 - at `\$\.scene\.rows\[0\]\.height_m`",
        ),
        (
            "[line]",
            "[[scene.decks]]\nname = 'd'\nfrom_m = 5.0\nto_m = 9.0\nwidth_m = 9.0\nclearance_m = 3.0\n[line]",
            r"antenna would hit it - at `\$\.scene\.decks\[0\]\.clearance_m`",
        ),
        ("[line]", "[line", "not TOML"),
    ],
)
def test_what_is_wrong_is_named_by_its_path(old: str, new: str, told: str) -> None:
    with pytest.raises(ScenarioError, match=told):
        scenario_from_toml(MINIMAL.replace(old, new, 1))


def test_files_that_are_no_scenario_are_named(tmp_path: Path) -> None:
    (tmp_path / "wrong.toml").write_text(MINIMAL.replace("bearing_deg", "baering_deg"), "utf-8")
    (tmp_path / "octets.toml").write_bytes(b"\xff\xfe")
    (tmp_path / "large.toml").write_bytes(b"#" * 1_000_001)
    for name, told in [("wrong", "baering_deg"), ("octets", "utf-8"), ("large", "1000001 bytes"), ("gone", "No such")]:
        with pytest.raises(ScenarioError, match=told) as caught:
            read_scenario(str(tmp_path / f"{name}.toml"))
        assert f"{name}.toml: " in str(caught.value)
    with pytest.raises(ScenarioError, match=r"there are: .*street_canyon"):
        read_scenario("street_cannon")


def test_buildings_stand_where_their_row_says(canyon: Scenario) -> None:
    line = axis_of(canyon.line)
    axis_m = np.arange(0.0, line.length_m, 0.5)
    axis = line.at(axis_m)
    for box in draw_boxes(canyon.scene, line, np.random.default_rng(2)):
        away = np.hypot(axis.x_m - box.x_m, axis.y_m - box.y_m)
        nearest = int(away.argmin())
        names = {place_name(canyon.scene, float(axis_m[nearest]) + d) for d in (-5.0, 5.0)}
        assert names - {"open"}
        # Half a metre of grid; a deck stands above the track, a building beside it by setback and half its depth.
        expected = 0.0 if box.bottom_m > 0 else 11.0 + box.depth_m / 2
        assert away[nearest] >= expected - 0.5


def test_one_sided_rows_stay_on_their_side(canyon: Scenario) -> None:
    line = axis_of(canyon.line)
    rows = tuple(msgspec.structs.replace(row, side="right") for row in canyon.scene.rows)
    for box in draw_boxes(msgspec.structs.replace(canyon.scene, rows=rows, decks=()), line, np.random.default_rng(2)):
        axis = line.at(np.arange(0.0, line.length_m))
        i = int(np.hypot(axis.x_m - box.x_m, axis.y_m - box.y_m).argmin())
        heading = axis.heading_rad[i]
        assert np.cos(heading) * (box.y_m - axis.y_m[i]) - np.sin(heading) * (box.x_m - axis.x_m[i]) < 0
