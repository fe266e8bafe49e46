"""The multipath probability: more evidence never lowers it, and reflections of known size on a made-up sky show."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.gnss import Epoch, SatelliteVerdict
from services.gnss_correction.atmosphere import L1_HZ, LIGHT_MPS
from services.gnss_correction.clock_jump import MILLISECOND_M
from services.gnss_correction.ephemeris_store import MOST_PER_SATELLITE
from services.gnss_correction.multipath_evidence import EVIDENCE
from services.gnss_correction.multipath_probability import (
    BASE,
    LIKELY,
    TERMS,
    contributions,
    evidence_in_words,
    features,
    probability,
)
from services.gnss_correction.pipeline import Correction, block_of
from services.gnss_correction.settings import Config
from services.gnss_correction.solve_file import blocks
from services.gnss_correction.verdict_messages import verdicts_of
from services.gnss_receiver.observations import observations_of
from tests.unit.gnss_correction.made_up_sky import START_S, WEEK, constellation, ephemeris, measured

GPS = constellation()
WAVELENGTH_M = LIGHT_MPS / L1_HZ
EPOCHS, STEP_AT, STEP_ENDS = 60, 20, 35
NAMES = EVIDENCE.names or ()
figures = st.fixed_dictionaries({
    name: st.floats(0.0, 1e6) | st.floats(-1e6, 0.0) if name in ("residual_m", "residual_mean_m", "deficit_db")
    else st.floats(0.0, 1e6)
    for name in NAMES
})  # fmt: skip


def row_of(**values: float) -> Any:  # noqa: ANN401 - a structured array
    row = np.full((1, len(NAMES)), np.nan).view(EVIDENCE)[:, 0]
    for name, value in values.items():
        row[name] = value
    return row


def of(**values: float) -> float:
    return float(probability(contributions(row_of(**values)))[0])


def drive(*, step_m: float = 0.0, noise_m: float = 0.3, seed: int = 1) -> list[Epoch]:
    """A standing receiver at 5 Hz with white code noise; the third satellite is reflected for three seconds."""
    generator = np.random.default_rng(seed)
    made = []
    clean = [measured(GPS, START_S + 0.2 * k, clocks_m={"G": 100.0 + 6.0 * k}) for k in range(EPOCHS)]
    for k, epoch in enumerate(clean):
        carrier = epoch.pseudorange_m / WAVELENGTH_M + 1_000.0
        pseudorange = epoch.pseudorange_m + noise_m * generator.standard_normal(len(epoch.satellites))
        if STEP_AT <= k < STEP_ENDS:
            pseudorange[2] += step_m
        made.append(msgspec.structs.replace(epoch, pseudorange_m=pseudorange, carrier_phase_cycles=carrier))
    return made


def judged(epochs: list[Epoch]) -> list[list[SatelliteVerdict]]:
    correction = Correction(Config())
    for one in GPS:
        correction.add(one)
    return [list(verdicts_of(correction.epoch(epoch))[0].satellites) for epoch in epochs]


def column(verdicts: list[list[SatelliteVerdict]], name: str) -> list[float]:
    found = [one.multipath_probability for epoch in verdicts for one in epoch if one.satellite == name]
    assert None not in found
    return [value for value in found if value is not None]


@given(figures)
def test_it_is_a_probability_whatever_the_evidence(values: dict[str, float]) -> None:
    assert 0.0 <= of(**values) <= 1.0


@given(figures, st.sampled_from(NAMES), st.floats(1.0, 1e3))
def test_more_evidence_never_lowers_it(values: dict[str, float], name: str, factor: float) -> None:
    more = values | {name: values[name] * factor if values[name] >= 0.0 or name != "deficit_db" else 0.0}
    # Equal sums may round apart in the last digit.
    assert of(**more) >= of(**values) - 1e-12


@pytest.mark.parametrize("term", TERMS)
def test_every_term_counts(term: Any) -> None:  # noqa: ANN401 - a Term
    assert of(**{term.name: 3.0}) > of()


def test_without_evidence_it_is_the_base_rate() -> None:
    assert of() == pytest.approx(1.0 / (1.0 + np.exp(-BASE)))
    assert not features(row_of()).any()


def test_the_words_name_the_strongest_evidence_first() -> None:
    row = row_of(residual_m=-30.0, deficit_db=20.0, change_hold_m=0.1)
    words = evidence_in_words(row[0], contributions(row)[0])
    assert words == "-30.0 m off the other satellites, C/N0 20 dB below its elevation's profile"


def test_a_clean_sky_stays_low() -> None:
    for epoch in judged(drive()):
        assert all(one.multipath_probability is not None and one.multipath_probability < 0.3 for one in epoch)


def test_a_reflection_of_20_m_is_believed_and_forgotten() -> None:
    epochs = drive(step_m=20.0)
    found = column(judged(epochs), epochs[0].satellites[2])
    assert max(found[:STEP_AT]) < 0.3
    assert min(found[STEP_AT:STEP_ENDS]) > LIKELY
    # Held peaks decay with 4 s: five seconds later nothing but a trace is left.
    assert max(found[-1:]) < 0.3
    others = [column(judged(epochs), name) for name in epochs[0].satellites[4:6]]
    assert all(max(one) < LIKELY for one in others)


def test_the_reason_names_the_reflection() -> None:
    epochs = drive(step_m=20.0)
    verdict = judged(epochs[: STEP_AT + 1])[-1][2]
    assert "probably reflected: +" in verdict.reason
    assert "m off the other satellites" in verdict.reason


def test_a_clock_jump_is_no_evidence() -> None:
    epochs = drive()
    jumped = [
        msgspec.structs.replace(one, pseudorange_m=one.pseudorange_m + MILLISECOND_M, tow_s=one.tow_s + 1e-3)
        if k >= STEP_AT
        else one
        for k, one in enumerate(epochs)
    ]
    for epoch in judged(jumped):
        assert all(one.multipath_probability is not None and one.multipath_probability < 0.3 for one in epoch)


@pytest.mark.parametrize("missing", ["doppler_hz", "carrier_phase_cycles", "cn0_dbhz"])
def test_a_missing_observable_costs_its_evidence_and_nothing_else(missing: str) -> None:
    epochs = [
        msgspec.structs.replace(one, **{missing: np.full(len(one.satellites), np.nan)}) for one in drive(step_m=40.0)
    ]
    found = column(judged(epochs), epochs[0].satellites[2])
    assert max(found[:STEP_AT]) < 0.3
    assert min(found[STEP_AT:STEP_ENDS]) > LIKELY


def test_a_gap_begins_changes_anew() -> None:
    epochs = drive()
    del epochs[10:30]
    for epoch in judged(epochs):
        assert all(one.multipath_probability is not None and one.multipath_probability < 0.3 for one in epoch)


def test_every_pseudorange_is_judged_from_the_first_epoch_on() -> None:
    first = judged(drive()[:1])[0]
    assert all(one.multipath_probability is not None for one in first)


def test_blocks_and_single_epochs_agree_to_the_bit() -> None:
    epochs = drive(step_m=20.0)
    correction = Correction(Config())
    for one in GPS:
        correction.add(one)
    whole = [v for block in blocks(observations_of(epochs)) for v in verdicts_of(correction.block(block))]
    assert [list(one.satellites) for one in whole] == judged(epochs)


def test_a_table_that_counts_from_another_week_changes_nothing() -> None:
    epochs = drive(step_m=20.0)
    steady, moved = Correction(Config(smooth_s=10.0)), Correction(Config(smooth_s=10.0))
    for correction in (steady, moved):
        for one in (ephemeris("J07"), *GPS):
            correction.add(one)
    for k, epoch in enumerate(epochs):
        if k == STEP_AT + 2:
            # The oldest is dropped, so that the first one known is of the week after.
            for issue in range(MOST_PER_SATELLITE):
                moved.add(ephemeris("J07", gps_week=WEEK + 1, toe_s=0.0, toc_s=0.0, issue=issue))
        found, again = steady.epoch(epoch), moved.epoch(epoch)
        assert (found.table.gps_week == again.table.gps_week) == (k < STEP_AT + 2)
        for name in ("change_hold_m", "slip_hold", "residual_m"):
            # Rounding of satellite places is all that may differ.
            np.testing.assert_allclose(again.evidence[name], found.evidence[name], atol=1e-4)


def test_a_slip_of_the_carrier_is_evidence() -> None:
    epochs = drive()
    slipped = epochs[STEP_AT].carrier_phase_cycles.copy()
    slipped[2] += 7.0
    epochs[STEP_AT] = msgspec.structs.replace(epochs[STEP_AT], carrier_phase_cycles=slipped)
    correction = Correction(Config())
    for one in GPS:
        correction.add(one)
    for epoch in epochs[: STEP_AT + 1]:
        evidence = correction.block(block_of(epoch)).evidence
    assert evidence["slip_hold"][2] == 1.0
    assert evidence["slip_hold"][[0, 1, 3]].max() < 1.0
