from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import pytest

from schemas.gnss import Ephemeris, Fix, Ionosphere
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.settings import Config
from services.gnss_receiver.observations import Observations
from services.simulator.scenario import Receiver, Scenario, Scene, Sky
from services.simulator.scenario_file import read_scenario


@pytest.fixture
def canyon() -> Scenario:
    """The scenario that comes with Kirotei."""
    return read_scenario("street_canyon")


@pytest.fixture
def ideal(canyon: Scenario) -> Scenario:
    """The same train without buildings, noise, model errors and clock steps."""
    return msgspec.structs.replace(
        canyon,
        scene=Scene(),
        sky=Sky(signal_in_space_sigma_m=0.0, ionosphere_scale=1.0),
        receiver=Receiver(noise_scale=0.0, cn0_satellite_sigma_db=0.0, clock_jump_s=0.0),
    )


Solve = Callable[[Observations, Sequence[Ephemeris], Ionosphere], list[Fix]]


@pytest.fixture
def solve() -> Solve:
    """Kirotei's own solution of every epoch, from every satellite above the horizon."""

    def solved(observations: Observations, ephemerides: Sequence[Ephemeris], ionosphere: Ionosphere) -> list[Fix]:
        correction = Correction(Config(method="original", compare=(), elevation_mask_deg=0.0))
        correction.add(ionosphere)
        for ephemeris in ephemerides:
            correction.add(ephemeris)
        fixes = fixes_of(correction.block(observations), "original")
        assert {fix.status for fix in fixes} == {"fix"}
        return fixes

    return solved
