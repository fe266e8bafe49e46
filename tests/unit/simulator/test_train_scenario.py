from __future__ import annotations

from pathlib import Path

import pytest

from services.simulator.motion_settings import AXLE_LOAD_CONTROLLED, Adhesion, Driving, Episode, Imu, Tacho, Vehicle
from services.simulator.random_track import TrackSettings
from services.simulator.scenario import ScenarioError
from services.simulator.scenario_file import alignment_for, embedded_scenarios, read_any_scenario, read_scenario
from services.simulator.scenario_limits import LIMITS
from services.simulator.train_route import RouteError, route_of
from services.simulator.train_scenario import Gnss, Journey, TrainScenario, train_scenario_from_toml


def test_the_scenarios_that_come_with_kirotei() -> None:
    trains = {name for name in embedded_scenarios() if isinstance(read_any_scenario(name), TrainScenario)}
    assert trains == {"demo_line", "slips_16permille", "slips_33permille", "curves_only", "wet_leaves", "bad_sensors"}
    for name in trains:
        scenario = read_any_scenario(name)
        assert isinstance(scenario, TrainScenario)
        loaded = alignment_for(scenario)
        assert (loaded is None) == (scenario.line is None)
        if loaded is not None:
            route_of(loaded.alignment, scenario.journey)


def test_a_train_is_no_receiver_alone() -> None:
    with pytest.raises(ScenarioError, match="whole train"):
        read_scenario("demo_line")


def test_a_vehicle_has_a_name_or_figures() -> None:
    assert train_scenario_from_toml('name="a"\nline="demo"\nvehicle="axle_load_controlled"').motion.vehicle == (
        AXLE_LOAD_CONTROLLED
    )
    own = train_scenario_from_toml('name="a"\nline="demo"\n[vehicle]\nteeth = 60\n').motion.vehicle
    assert (own.teeth, own.wheel_diameter_m) == (60, 0.816)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name="a"\nline="demo"\n[imu]\ngrde = "mems"', r"unknown field `grde` - at `\$.imu`"),
        ('name="a"\nline="demo"\n[imu]\ngrade = "best"', r"Invalid enum value 'best' - at `\$.imu.grade`"),
        ('name="a"\nline="demo"\n[tacho]\nrate_hz = 50', r"at `\$.tacho.rate_hz`"),
        ('name="a"\nline="demo"\n[[faults]]\nkind = "explodes"\nat_s = 1.0', r"at `\$.faults\[0\].kind`"),
        ('name="a"\nline="demo"\n[track]\n', "either `line` or a"),
        ('name="a"\n[track]\n[gnss]\n', "lies nowhere on Earth"),
        ('name="a"\n[track]\nradius_m = [800.0, 300.0]', r"track.radius_m \(800, 300\) is no rising range"),
        ('name="a"\nline="demo"\n[receiver]\ninterval_s = 0.25', "multiple of 0.1 s"),
        ('name="a"\nline="demo"\n[driving]\ndwell_s = [5.0, nan]', "no rising range"),
        ('name="a"\nline="demo"\n[adhesion]\nslide_share = nan', r"at `\$.adhesion.slide_share`"),
        ('name="a"\nline="demo"\nmax_gradient_permille = inf', r"finite number is wanted - at `\$.max_gradient"),
        ('name="a"\nline="demo"\n[vehicle]\nlength_m = 60_000.0', r"1 to 2000 m is wanted - at `\$.vehicle.length_m`"),
        ('name="a"\nline="demo"\n[driving]\ndwell_s = [5.0, 1e9]', r"1e\+09 is beyond .* - at `\$.driving.dwell_s`"),
        ('name="a"\n[track]\nstop_every_m = [0.0, 900.0]', r"100 to 200000 m is wanted - at `\$.track.stop_every_m`"),
        (
            'name="a"\nline="demo"\n[[adhesion.episodes]]\nat_s = 1.0\nduration_s = 1e300',
            r"at `\$.adhesion.episodes\[0\].duration_s`",
        ),
        (
            'name="a"\nline="demo"\n[[faults]]\nkind = "imu_late"\nat_s = 1.0\nmagnitude = 2000.0',
            r"a magnitude of 2000 for imu_late: 0 to 60 s is wanted - at `\$.faults\[0\]`",
        ),
        ('name="a"\nline="demo"\n[tacho]\nmissing_teeth = 90', "the wheel has 90"),
        ('name="a"\nline="demo"\n[adhesion]\nrandom_gap_s = 30.0\n[adhesion.weights]\nlocked = 0.0', "weights"),
    ],
)
def test_a_wrong_field_is_named_by_its_path(text: str, words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        train_scenario_from_toml(text)


def test_journeys_that_the_line_does_not_allow_are_refused() -> None:
    loaded = alignment_for(train_scenario_from_toml('name="a"\nline="demo"'))
    assert loaded is not None
    with pytest.raises(RouteError, match=r"no station 'nowhere' on this route; there are: kirihama, matsuo"):
        route_of(loaded.alignment, Journey(stops=("nowhere",)))
    with pytest.raises(RouteError, match="outside the route"):
        route_of(loaded.alignment, Journey(start_axis_m=99_000.0))
    with pytest.raises(ScenarioError, match="branch"):
        alignment_for(train_scenario_from_toml('name="a"\nline="demo"\n[journey]\nbranch = "nowhere"'))


def test_limits_are_those_of_fields_that_there_are() -> None:
    parts = (Journey, Vehicle, Driving, Adhesion, Episode, Imu, Tacho, Gnss, TrackSettings, TrainScenario)
    known = {part.__name__: set(part.__struct_fields__) for part in parts}
    assert {name: set(fields) - known[name] for name, fields in LIMITS.items()} == {name: set() for name in known}


def test_a_broken_line_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "broken.json"
    path.write_text('{"id": 1}', "utf-8")
    with pytest.raises(ScenarioError, match=r"broken\.json"):
        alignment_for(train_scenario_from_toml(f'name="a"\nline="{path}"'))
