from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from schemas.gnss import Ephemeris, Ionosphere
from services.gnss_correction.ephemeris_table import tabulate
from services.gnss_correction.preparation import prepare
from services.gnss_correction.solution import Solver
from services.gnss_correction.solver_arrays import RULES
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


Solve = Callable[[Observations, Sequence[Ephemeris], Ionosphere], NDArray[np.float64]]


@pytest.fixture
def solve() -> Solve:
    """Kirotei's own solver: Earth-fixed positions and velocities in rows of six, every satellite used."""

    def solved(
        observations: Observations, ephemerides: Sequence[Ephemeris], ionosphere: Ionosphere
    ) -> NDArray[np.float64]:
        ready = prepare(observations, tabulate(ephemerides), "GE")
        rules = np.zeros(1, RULES)
        rules["most_pdop"] = 30.0
        rules["alpha"], rules["beta"] = ionosphere.alpha, ionosphere.beta
        fixes = Solver().solve(ready.first_row, ready.t_s, ready.rows, rules[0])
        return np.stack([fixes[name] for name in ("x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps")], axis=1)

    return solved
