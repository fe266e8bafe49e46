"""Observation files damaged at random: no figure is ever wrong."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.gnss_receiver.observations import Observations, satellite_name
from services.gnss_receiver.rinex_error import RinexError
from services.gnss_receiver.rinex_observations import parse_observations
from tests.unit.gnss_receiver.samples import (
    MANY,
    epoch_2,
    epoch_3,
    expected,
    header_2,
    header_3,
    text_of,
)

Build = tuple[list[str], Callable[..., list[str]]]
BOTH: dict[str, Build] = {"2": (header_2(), epoch_2), "3": (header_3(), epoch_3)}
both = pytest.mark.parametrize("build", BOTH.values(), ids=BOTH.keys())


def read(*parts: list[str]) -> Observations:
    return parse_observations(text_of(*parts), "a.rnx")


Lines = list[bytes]


def _without(lines: Lines, at: int, _: random.Random) -> Lines:
    return lines[:at] + lines[at + 1 :]


def _twice(lines: Lines, at: int, _: random.Random) -> Lines:
    return [*lines[: at + 1], lines[at], *lines[at + 1 :]]


def _joined(lines: Lines, at: int, _: random.Random) -> Lines:
    return [*lines[:at], b"".join(lines[at : at + 2]), *lines[at + 2 :]]


# By less than a field: a shift by whole fields leaves a well-formed line.
def _shifted(lines: Lines, at: int, generator: random.Random) -> Lines:
    return [*lines[:at], b" " * generator.randint(1, 15) + lines[at], *lines[at + 1 :]]


def _clipped(lines: Lines, at: int, generator: random.Random) -> Lines:
    return [*lines[:at], lines[at][generator.randint(1, 15) :], *lines[at + 1 :]]


def _cut(lines: Lines, at: int, generator: random.Random) -> Lines:
    return [*lines[:at], lines[at][: generator.randrange(len(lines[at]) + 1)], *lines[at + 1 :]]


def _garbage(lines: Lines, at: int, generator: random.Random) -> Lines:
    return [*lines[:at], bytes(generator.choices(b"\x00\xffx?*> &", k=generator.randint(0, 90))), *lines[at:]]


def _overwritten(lines: Lines, at: int, generator: random.Random) -> Lines:
    start = generator.randrange(len(lines[at]) + 1)
    bad = bytes(generator.choices(b"\x00\xffx?*", k=generator.randint(1, 30)))
    return [*lines[:at], lines[at][:start] + bad + lines[at][start + len(bad) :], *lines[at + 1 :]]


DAMAGES = (_without, _twice, _joined, _shifted, _clipped, _cut, _garbage, _overwritten)


@both
@settings(max_examples=400)
@given(damage=st.sampled_from(DAMAGES), place=st.integers(0, 10_000), seed=st.integers(0, 10_000))
def test_no_damage_makes_a_wrong_figure(
    build: Build, damage: Callable[[Lines, int, random.Random], Lines], place: int, seed: int
) -> None:
    header, epoch = build
    satellites = MANY
    lines = text_of(header, *(epoch(index, satellites) for index in range(3))).splitlines()
    damaged = damage(lines, place % len(lines), random.Random(seed))  # noqa: S311 - damage is no secret
    try:
        observations = parse_observations(b"\n".join(damaged), "damaged.rnx")
    except RinexError:
        assert place % len(lines) < len(header)
        return
    whole = expected(3, satellites)
    for index in range(len(observations)):
        for row in range(int(observations.first_row[index]), int(observations.first_row[index + 1])):
            satellite = satellite_name(int(observations.satellite[row]))
            key = (int(observations.gps_week[index]), float(observations.tow_s[index]), satellite, "1C")
            c, phase, d, s = whole[key]
            assert observations.pseudorange_m[row] == c or np.isnan(observations.pseudorange_m[row])
            assert observations.carrier_phase_cycles[row] == phase or np.isnan(observations.carrier_phase_cycles[row])
            assert observations.doppler_hz[row] == d or np.isnan(observations.doppler_hz[row])
            assert observations.cn0_dbhz[row] == s or np.isnan(observations.cn0_dbhz[row])
