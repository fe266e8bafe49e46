from __future__ import annotations

import numpy as np
import pytest

from services.radio_anomaly import paper
from tests.unit.radio_anomaly.made_up import one_pass

K = 3.0


def learned() -> dict[paper.Key, paper.Threshold]:
    readings = [one for number in range(20) for one in one_pass(number, spread_db=0.5)]
    return paper.thresholds_of(paper.sums_of(readings, 100.0), K)


def test_thresholds_are_mean_and_k_standard_deviations() -> None:
    powers = [one.power_dbm or 0.0 for n in range(20) for one in one_pass(n) if 500 <= (one.chainage_m or 0) < 600]
    limits = paper.thresholds_of(paper.sums_of([one for n in range(20) for one in one_pass(n)], 100.0), K)[
        ("W1", "ch1", 5)
    ]
    # Σ² - (Σ)²/n of powers about -80 dBm loses four digits of sixteen.
    assert limits.mean_dbm == pytest.approx(np.mean(powers))
    assert limits.upper_dbm == pytest.approx(np.mean(powers) + K * np.std(powers), abs=1e-8)
    assert limits.lower_dbm == pytest.approx(np.mean(powers) - K * np.std(powers), abs=1e-8)
    assert limits.samples == len(powers)


@pytest.mark.parametrize(("change_db", "kind", "cause"), [(-10.0, "below", "unknown"), (15.0, "above", "interference")])
def test_a_fault_on_a_stretch_is_one_excess(change_db: float, kind: str, cause: str) -> None:
    rows = one_pass(30, change_db=change_db, stretch=(10, 14), spread_db=0.1)
    found = paper.analyse(rows, learned(), 100.0, K)
    assert [(one.start, one.length, one.kind, one.cause) for one in found] == [(10, 4, kind, cause)]
    assert "1" in found[0].reason


def test_a_sample_at_the_threshold_is_beyond_it() -> None:
    limits = learned()
    edge = limits[("W1", "ch1", 3)].upper_dbm
    row = one_pass(0)[9]
    on_edge = [type(row)(t_ns=0, pass_id="p", radio="W1", channel="ch1", direction="up", chainage_m=350.0, power_dbm=p)
               for p in (edge, edge - 1e-6)]  # fmt: skip
    assert len(paper.analyse(on_edge[:1], limits, 100.0, K)) == 1
    assert paper.analyse(on_edge[1:], limits, 100.0, K) == []


def test_one_sample_makes_no_threshold() -> None:
    assert paper.thresholds_of(paper.sums_of(one_pass(0)[:1], 100.0), K) == {}
