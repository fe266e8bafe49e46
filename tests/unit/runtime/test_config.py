"""Profiles: what is accepted, and how every fault is named."""

from __future__ import annotations

import re
from enum import Enum
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec import Meta

from services.runtime.config import ConfigError, Profile, load_host, parse_host
from services.runtime.host_config import HostConfig
from services.runtime.node import Node, Service

KNOWN = ("gnss_correction", "gnss_receiver", "recorder")
THRICE = '["remove", "remove", "remove"]'
PLACE = '[place]\nline = "demo"\nkind = "train"\nname = "T1"\n'


class Weighting(Enum):
    ELEVATION = "elevation"
    CN0 = "cn0"


class Weights(msgspec.Struct, frozen=True, kw_only=True):
    """Deliberately without forbid_unknown_fields: the configuration refuses them all the same."""

    cn0: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.0


class Window(msgspec.Struct, frozen=True, kw_only=True):
    start_s: float
    end_s: float

    def __post_init__(self) -> None:
        if self.end_s <= self.start_s:
            msg = f"end_s {self.end_s} is not after start_s {self.start_s}"
            raise ValueError(msg)


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    threshold_m: Annotated[float, Meta(ge=0.0)] = 0.45
    method: Literal["original", "remove", "adjust"] = "original"
    compare: Annotated[tuple[Literal["original", "remove"], ...], Meta(max_length=2)] = ()
    label: str = ""
    seed: int | None = None
    smooth: bool = False
    weighting: Weighting = Weighting.ELEVATION
    weights: Weights = Weights()
    windows: tuple[Window, ...] = ()
    origin: tuple[float, float] | None = None
    by_receiver: dict[str, Weights] = msgspec.field(default_factory=dict)


async def _run(node: Node, config: Settings) -> None:
    del node, config


SERVICE = Service("gnss_correction", Settings, (), (), _run, "a test's service")


def profile_of(text: str, **environment: str) -> Profile:
    return parse_host(text, "x.toml", None, environment, KNOWN)


def settings_of(table: str, **environment: str) -> Settings:
    profile = profile_of(f"{PLACE}[gnss_correction]\n{table}", **environment)
    return profile.service_config("gnss_correction", SERVICE)


def problems_of(text: str, **environment: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        profile_of(text, **environment)
    return caught.value.problems


def service_problems_of(table: str, **environment: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        settings_of(table, **environment)
    return caught.value.problems


def test_a_table_becomes_a_frozen_struct_with_defaults() -> None:
    settings = settings_of('threshold_m = 1\nmethod = "remove"\n[gnss_correction.weights]\ncn0 = 2.5\n')
    assert settings == Settings(threshold_m=1.0, method="remove", weights=Weights(cn0=2.5))
    assert isinstance(settings.threshold_m, float)


def test_no_table_gives_the_defaults() -> None:
    assert profile_of(PLACE).service_config("gnss_correction", SERVICE) == Settings()


def test_an_instance_has_its_own_table_alone() -> None:
    text = f'services = ["gnss_correction", "gnss_correction@rear"]\n{PLACE}[gnss_correction]\nthreshold_m = 2.0\n'
    profile = profile_of(f'{text}["gnss_correction@rear"]\nlabel = "rear"\n')
    assert profile.service_config("gnss_correction@rear", SERVICE) == Settings(label="rear")
    assert profile.instances() == ("gnss_correction", "gnss_correction@rear")


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ("threshold_m = -1", "gnss_correction.threshold_m: expected float >= 0, got -1"),
        ('threshold_m = "wide"', 'gnss_correction.threshold_m: expected float >= 0, got "wide"'),
        ("threshold_m = nan", "gnss_correction.threshold_m: expected a finite number, got NaN"),
        ("threshold_m = inf", "gnss_correction.threshold_m: expected a finite number, got Infinity"),
        ("treshold_m = 1.0", "gnss_correction.treshold_m: unknown field, did you mean threshold_m?"),
        ("zzz = 1.0", "gnss_correction.zzz: unknown field"),
        ('method = "move"', 'gnss_correction.method: expected one of adjust, original, remove, got "move"'),
        ('weighting = "size"', 'gnss_correction.weighting: expected one of elevation, cn0, got "size"'),
        ("smooth = 1", "gnss_correction.smooth: expected true or false, got 1"),
        ("seed = 1.5", "gnss_correction.seed: expected int, or nothing, got 1.5"),
        ("weights.cn0 = 0", "gnss_correction.weights.cn0: expected float > 0 and <= 10, got 0"),
        ("weights.cn9 = 1", "gnss_correction.weights.cn9: unknown field, did you mean cn0?"),
        ("weights = 3", "gnss_correction.weights: expected table, got 3"),
        ('compare = ["original", "x"]', 'gnss_correction.compare[1]: expected one of original, remove, got "x"'),
        (
            "compare = ['remove', 'remove', 'remove']",
            f"gnss_correction.compare: expected list of one of original, remove (at most 2 entries), got {THRICE}",
        ),
        ("origin = [1.0]", "gnss_correction.origin: expected [float, float], or nothing, got [1.0]"),
        ("windows = [{start_s = 0.0}]", "gnss_correction.windows[0].end_s: missing: expected float"),
        (
            "windows = [{start_s = 2.0, end_s = 1.0}]",
            "gnss_correction.windows[0]: end_s 1.0 is not after start_s 2.0",
        ),
        ("by_receiver.front.cn0 = -1", "gnss_correction.by_receiver.front.cn0: expected float > 0 and <= 10, got -1"),
    ],
)
def test_a_fault_is_named_by_file_and_path(table: str, problem: str) -> None:
    assert service_problems_of(table) == (f"x.toml: {problem}",)


def test_every_fault_is_named_at_once() -> None:
    found = service_problems_of('threshold_m = -1\nmethod = "x"\nlable = "y"\n')
    assert [line.split(": ")[1] for line in found] == [
        "gnss_correction.threshold_m",
        "gnss_correction.method",
        "gnss_correction.lable",
    ]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("place = \n", "x.toml:1: Invalid value (column 9)"),
        (f"{PLACE}services = [\n", "x.toml:6: Invalid value"),
        ("a = 1\na = 2\n", "x.toml:2: Cannot overwrite a value (column 6)"),
    ],
)
def test_broken_toml_is_named_by_line(text: str, line: str) -> None:
    (problem,) = problems_of(text)
    assert problem.startswith(line.removesuffix(" (column 6)"))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "place: missing: expected table"),
        ('[place]\nline = "demo"\nkind = "train"\n', "place.name: missing: expected string"),
        (PLACE.replace("train", "ship"), 'place.kind: expected one of cloud, train, wayside, got "ship"'),
        (PLACE.replace('"T1"', '"a/b"'), "place.name: expected string matching"),
        (f"servces = []\n{PLACE}", "servces: unknown field or service, did you mean services?"),
        (f"{PLACE}[gnss_corection]\n", "gnss_corection: unknown field or service, did you mean gnss_correction?"),
        (f"gnss_correction = 3\n{PLACE}", "gnss_correction: expected a table [gnss_correction]"),
        (
            f'services = ["gnss_reciever"]\n{PLACE}',
            "services[0]: no service 'gnss_reciever', did you mean gnss_receiver?",
        ),
        (f'services = ["recorder", "recorder"]\n{PLACE}', "services[1]: 'recorder' stands twice"),
        (f'{PLACE}[bus]\nconnect = ["localhost"]\n', "bus.connect[0]: expected string matching"),
        (f"{PLACE}[bus]\nconnect = []\n", "bus.connect: expected list of string"),
        (f"{PLACE}[router]\nlease_s = 0.1\n", "router.lease_s: expected float >= 0.5 and <= 60, got 0.1"),
        (f'{PLACE}[log]\nlevel = "loud"\n', "log.level: expected one of debug, error, info, warning"),
    ],
)
def test_faults_of_the_shared_part(text: str, problem: str) -> None:
    assert any(line.startswith(f"x.toml: {problem}") for line in problems_of(text))


@pytest.mark.parametrize(
    ("variable", "text", "expected"),
    [
        ("METHOD", "remove", Settings(method="remove")),
        ("THRESHOLD_M", "2", Settings(threshold_m=2.0)),
        ("SMOOTH", "true", Settings(smooth=True)),
        ("COMPARE", '["remove"]', Settings(compare=("remove",))),
        ("COMPARE", "['remove']", Settings(compare=("remove",))),
        ("SEED", "null", Settings(seed=None)),
        ("LABEL", "5", Settings(label="5")),
        ("LABEL", "true", Settings(label="true")),
        ("WEIGHTS__CN0", "0.5", Settings(weights=Weights(cn0=0.5))),
        ("WEIGHTS", "{cn0 = 0.5}", Settings(weights=Weights(cn0=0.5))),
        ("WEIGHTING", "cn0", Settings(weighting=Weighting.CN0)),
    ],
)
def test_the_environment_overrides_with_the_type_that_the_field_wants(
    variable: str, text: str, expected: Settings
) -> None:
    assert settings_of("", **{f"KIROTEI__GNSS_CORRECTION__{variable}": text}) == expected


def test_an_override_keeps_its_neighbours_in_the_table() -> None:
    settings = settings_of("threshold_m = 3.0\nweights.cn0 = 4.0", KIROTEI__GNSS_CORRECTION__WEIGHTS__CN0="5")
    assert settings == Settings(threshold_m=3.0, weights=Weights(cn0=5.0))


def test_a_fault_of_the_environment_names_the_variable() -> None:
    assert service_problems_of("", KIROTEI__GNSS_CORRECTION__THRESHOLD_M="-1") == (
        "environment KIROTEI__GNSS_CORRECTION__THRESHOLD_M: expected float >= 0, got -1",
    )
    assert service_problems_of("", KIROTEI__GNSS_CORRECTION__TRESHOLD_M="1") == (
        "environment KIROTEI__GNSS_CORRECTION__TRESHOLD_M: unknown field, did you mean threshold_m?",
    )
    (problem,) = problems_of(PLACE, KIROTEI__GNSS_CORECTION__METHOD="remove")
    assert problem.startswith("environment KIROTEI__GNSS_CORECTION__METHOD: unknown field or service 'gnss_corection'")
    assert problem.endswith(", did you mean gnss_correction?")


def test_the_environment_reaches_shared_fields_and_instances() -> None:
    text = f'services = ["gnss_correction@Rear-1"]\n{PLACE}'
    profile = profile_of(
        text,
        KIROTEI__PLACE__NAME="T2",
        KIROTEI__STATE_DIR="/var/x",
        KIROTEI__GNSS_CORRECTION_REAR_1__LABEL="rear",
        KIROTEI_STATE_DIR="not ours: one underscore",
    )
    assert (profile.host.place.name, profile.host.state_dir) == ("T2", "/var/x")
    assert profile.service_config("gnss_correction@Rear-1", SERVICE).label == "rear"
    assert profile.service_config("gnss_correction", SERVICE).label == ""


def test_the_embedded_profile_loads_without_a_file() -> None:
    profile = load_host(None, {})
    assert profile.host.place.place().kind == "train"
    assert profile.host.services


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    absent = tmp_path / "absent.toml"
    with pytest.raises(ConfigError, match=r"absent\.toml: cannot read: No such file"):
        load_host(absent, {}, KNOWN)
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b"a = '\xe9'\n")
    with pytest.raises(ConfigError, match=r"latin\.toml: not UTF-8 at byte 5"):
        load_host(latin, {}, KNOWN)


@given(st.dictionaries(st.sampled_from([*HostConfig.__struct_fields__, "recorder", "x"]), st.none() | st.integers()))
def test_any_shape_of_values_gives_a_profile_or_a_named_fault(document: dict[str, int | None]) -> None:
    text = "\n".join(f"{name} = {'{}' if value is None else value}" for name, value in document.items())
    with pytest.raises(ConfigError) as caught:
        profile_of(text)
    assert all(line.startswith("x.toml: ") for line in caught.value.problems)


@given(st.text(max_size=60).filter(lambda text: not re.match(r"[-+]?[\d.]", text.strip())))
@example("-x")
def test_any_words_where_a_number_is_wanted_are_named(text: str) -> None:
    with pytest.raises(ConfigError, match="environment KIROTEI__GNSS_CORRECTION__THRESHOLD_M: expected "):
        settings_of("", KIROTEI__GNSS_CORRECTION__THRESHOLD_M=text)
