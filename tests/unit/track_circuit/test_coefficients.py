"""Stored coefficients: the right set for circuit, profile and place; gentle learning; a file that is whole."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from schemas.position import TrainPosition
from schemas.track_circuit import CoefficientStore, StoredCoefficients
from services.track_circuit.circuit_choice import circuit_at
from services.track_circuit.coefficients import (
    DRIFT_LIMIT,
    TrainingError,
    adapted,
    choose,
    coefficients_of,
    distance_bin,
    drift,
    learned,
    profile_digest,
    taps_of,
    with_set,
)
from services.track_circuit.coefficients_store import StoreError, read_store, write_store
from services.track_circuit.profile import Framing, Profile
from services.track_circuit.receiver_demodulation import demodulate
from services.track_circuit.reference_store import KeptReference, ReferencesError, read_references, write_references
from services.track_circuit.settings import CircuitSettings

PROFILE = Profile()
TAPS = np.array([1.0 + 0.0j, 0.3 - 0.2j, -0.1 + 0.05j])


def one_set(
    circuit: str = "T1", receiver: str = "mlse", stretch: tuple[float, float] | None = None, profile: Profile = PROFILE
) -> StoredCoefficients:
    made = coefficients_of(
        profile, circuit, receiver, TAPS, trained="2026-11-22", level_db=-20.0, evm_db=-15.0, symbols=500
    )
    return msgspec.structs.replace(made, distance_bin_m=stretch)


def test_framing_and_pilot_bits_are_no_other_profile_but_carrier_and_row_are() -> None:
    same = Profile(framing=Framing(), pilot_bits="0110")
    assert profile_digest(same) == profile_digest(PROFILE)
    assert profile_digest(Profile(carrier_hz=11_000.0)) != profile_digest(PROFILE)
    assert profile_digest(Profile(ch2_row=10)) != profile_digest(PROFILE)


def test_sets_of_others_are_refused_with_the_reason() -> None:
    store = CoefficientStore(sets=(one_set(), one_set("T2", profile=Profile(ch2_row=10)), one_set("T3", "rls")))
    assert choose(store, "T1", PROFILE, "mlse").chosen == store.sets[0]
    assert "no coefficients" in choose(store, "T9", PROFILE, "mlse").reason
    assert "another profile" in choose(store, "T2", PROFILE, "mlse").reason
    assert "rls" in choose(store, "T3", PROFILE, "mlse").reason


def test_on_board_the_stretch_goes_before_the_whole_circuit() -> None:
    store = CoefficientStore(sets=(one_set(), one_set(stretch=(200.0, 300.0))))
    assert choose(store, "T1", PROFILE, "mlse", 250.0).chosen == store.sets[1]
    assert choose(store, "T1", PROFILE, "mlse", 350.0).chosen == store.sets[0]
    assert choose(store, "T1", PROFILE, "mlse").chosen == store.sets[0]
    only = CoefficientStore(sets=(store.sets[1],))
    assert "this stretch" in choose(only, "T1", PROFILE, "mlse", 350.0).reason


def test_training_again_counts_the_version_and_replaces() -> None:
    store, first = with_set(CoefficientStore(), one_set())
    store, second = with_set(store, one_set())
    store, other = with_set(store, one_set(stretch=(0.0, 100.0)))
    assert (first.version, second.version, other.version, len(store.sets)) == (1, 2, 1, 2)
    store, kept = with_set(store, one_set(), trained=False)
    assert (kept.version, len(store.sets)) == (2, 2)


def test_phase_and_level_of_the_day_are_no_drift() -> None:
    stored = one_set()
    assert drift(TAPS * (0.1 * np.exp(2.0j)), stored) == pytest.approx(0.0, abs=1e-7)
    assert drift(np.array([0.2 + 0.3j, 1.0, 0.0]), stored) == pytest.approx(
        # 1 - |<a, b>|^2 / (|a|^2 |b|^2), by hand.
        np.sqrt(1.0 - abs(np.vdot([0.2 + 0.3j, 1.0, 0.0], TAPS)) ** 2 / (1.13 * np.linalg.norm(TAPS) ** 2))
    )
    assert drift(np.zeros(3, np.complex128), stored) is None
    assert drift(np.ones(4, np.complex128), stored) is None


def test_learning_goes_towards_near_taps_and_never_far() -> None:
    trained = stored = one_set()
    near = TAPS + np.array([0.0, 0.1j, 0.1])
    for _ in range(400):
        stored = adapted(stored, trained, near * 3.0j)
    assert drift(near, stored) == pytest.approx(0.0, abs=0.01)
    far = np.array([0.0, 0.0, 1.0 + 0.0j])
    assert adapted(stored, trained, far) == stored
    assert adapted(stored, trained, np.full(3, np.nan + 0j)) == stored
    moved = taps_of(stored).taps - TAPS
    assert np.linalg.norm(moved) <= DRIFT_LIMIT * np.linalg.norm(TAPS) + 1e-12


def test_feedback_taps_take_no_part_in_the_signals_gain() -> None:
    generator = np.random.default_rng(9)
    forward = generator.normal(size=16) + 1j * generator.normal(size=16)
    feedback = np.array([0.3, 0.2j, -0.1, 0.0])
    taps = np.concatenate([forward, feedback])
    trained = stored = coefficients_of(
        PROFILE, "T1", "dfe", taps, trained="2026-11-22", level_db=-20.0, evm_db=-15.0, symbols=500
    )
    louder = np.concatenate([forward * (0.1 - 3.0j), feedback])
    assert drift(louder, trained) == pytest.approx(0.0, abs=1e-6)
    for _ in range(50):
        stored = adapted(stored, trained, louder)
    assert np.allclose(taps_of(stored).taps, taps)


def test_silence_and_short_runs_teach_nothing() -> None:
    silence = demodulate(np.zeros(9600), 48_000.0, PROFILE)
    with pytest.raises(TrainingError, match="no signal"):
        learned(silence, PROFILE, "T1", "2026-11-22")


def test_the_file_comes_back_whole_and_damage_is_told(tmp_path: Path) -> None:
    path = tmp_path / "below" / "coefficients.json"
    assert read_store(path) == CoefficientStore()
    store, _ = with_set(CoefficientStore(), one_set(stretch=(0.0, 100.0)))
    write_store(path, store)
    assert read_store(path) == store
    assert [entry.name for entry in path.parent.iterdir()] == ["coefficients.json"]
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(StoreError, match=r"coefficients\.json"):
        read_store(path)
    path.write_text('{"version": 1, "sets": [{"circuit": "T1"}]}')
    with pytest.raises(StoreError, match="receiver"):
        read_store(path)


def test_sets_without_taps_or_with_absurd_numbers_are_refused() -> None:
    for change in ({"taps": ()}, {"level_db": float("nan")}, {"distance_bin_m": (5.0, 5.0)}):
        with pytest.raises(ValueError, match="T1"):
            msgspec.convert(msgspec.to_builtins(one_set()) | change, StoredCoefficients)


def test_levels_of_clear_circuits_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "references.json"
    assert read_references(path) == {}
    write_references(path, {"T1": KeptReference(level_db=-20.0, t_ns=5)})
    assert read_references(path)["T1"].level_db == -20.0
    path.write_text("{")
    with pytest.raises(ReferencesError, match=r"references\.json"):
        read_references(path)


def position(axis_m: float | None, status: str = "valid") -> TrainPosition:
    plain = {"t_ns": 0, "status": status, "reason": "", "branch": "", "axis_m": axis_m}
    return msgspec.convert(plain, TrainPosition)


def test_the_circuit_under_the_train_is_found_by_its_place() -> None:
    circuits = (
        CircuitSettings(name="A", sending_axis_m=1000.0, length_m=500.0),
        CircuitSettings(name="B", sending_axis_m=2000.0, length_m=500.0, receiving="down"),
        CircuitSettings(name="C"),
    )
    assert circuit_at(circuits, position(1250.0)) == ("A", 250.0)
    assert circuit_at(circuits, position(1750.0)) == ("B", 250.0)
    assert circuit_at(circuits, position(2100.0)) is None
    assert circuit_at(circuits, position(None, "lost")) is None
    assert distance_bin(250.0) == (200.0, 300.0)
