from __future__ import annotations

import msgspec
import pytest

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
