from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from services.track_circuit.least_squares import least_squares
from services.track_circuit.lms import Adapted, lms, run_adaptive
from services.track_circuit.nlms import nlms
from services.track_circuit.rls import Rls

WANTED = np.array([0.3 - 0.4j, 1.0 + 0.2j, -0.5j, 0.1 + 0.6j])


def scene(count: int, stride: int) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    generator = np.random.default_rng(3)
    inputs = generator.normal(size=stride * count + 8) + 1j * generator.normal(size=stride * count + 8)
    target = np.array([inputs[stride * k : stride * k + 4] @ WANTED for k in range(count)])
    return inputs, target


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize(
    "algorithm",
    [
        lambda x, t, s: lms(x, t, np.zeros(4, np.complex128), 0.3, s),
        lambda x, t, s: nlms(x, t, np.zeros(4, np.complex128), 0.5, s),
        lambda x, t, s: Rls(np.zeros(4, np.complex128)).run(x, t, s),
    ],
    ids=["lms", "nlms", "rls"],
)
def test_complex_filters_are_identified_not_their_conjugates(
    algorithm: Callable[[NDArray[np.complex128], NDArray[np.complex128], int], Adapted], stride: int
) -> None:
    inputs, target = scene(2000, stride)
    found = algorithm(inputs, target, stride)
    assert np.allclose(found.taps, WANTED, atol=1e-3)  # RLS is biased by its start, 0.01 over 2000 inputs
    assert np.allclose(found.best, WANTED, atol=1e-3)
    assert np.abs(found.error[-1]) < 1e-2 < np.abs(found.error[0])


@pytest.mark.parametrize("normalised", [True, False])
def test_the_kernel_equals_the_plain_equation(*, normalised: bool) -> None:
    inputs, target = scene(300, 2)
    target += 0.3 * np.exp(1j * np.arange(300))
    taps, keep = np.zeros(4, np.complex128), 1.0 - 1e-3
    errors = []
    for k in range(300):
        x = inputs[2 * k : 2 * k + 4]
        errors.append(target[k] - taps @ x)
        gain = 0.02 / (np.vdot(x, x).real if normalised else 1.0)
        taps = keep * taps + gain * errors[-1] * x.conj()
    found = run_adaptive(
        inputs, target, np.zeros(4, np.complex128), step=0.02, stride=2, normalised=normalised, leakage=1e-3
    )
    assert np.allclose(found.taps, taps, rtol=1e-9)  # only the order of sums differs
    assert np.allclose(found.error, errors, rtol=1e-9)


def test_the_best_taps_are_those_before_the_channel_broke() -> None:
    inputs, target = scene(1000, 1)
    target[700:] = 0.0
    found = nlms(inputs, target, np.zeros(4, np.complex128), 0.5)
    assert np.allclose(found.best, WANTED, atol=1e-6)
    assert not np.allclose(found.taps, WANTED, atol=0.1)


def test_rls_equals_least_squares_over_the_same_rows() -> None:
    inputs, target = scene(60, 2)
    target += 0.1 * np.exp(2j * np.arange(60))
    recursive = Rls(np.zeros(4, np.complex128), delta=1e-9).run(inputs, target, 2).taps
    assert np.allclose(recursive, least_squares(inputs, target, 4, 2, ridge=1e-12), atol=1e-6)  # their priors differ


def test_rls_stays_hermitian_over_a_long_run() -> None:
    generator = np.random.default_rng(5)
    inputs = generator.normal(size=40_008) + 1j * generator.normal(size=40_008)
    target = np.convolve(inputs, WANTED[::-1], "valid")[:40_000]
    found = Rls(np.zeros(4, np.complex128), forgetting=0.99).run(inputs, target)
    assert np.allclose(found.taps, WANTED, atol=1e-9)  # 100 samples of memory, no noise


def test_too_few_inputs_are_refused() -> None:
    with pytest.raises(ValueError, match="needed"):
        nlms(np.zeros(5, np.complex128), np.zeros(4, np.complex128), np.zeros(4, np.complex128), 0.5)
