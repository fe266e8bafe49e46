from __future__ import annotations

import numpy as np
import pytest

from services.track_circuit.walsh import code, hadamard


@pytest.mark.parametrize("length", [2, 8, 16, 64])
def test_rows_are_orthogonal(length: int) -> None:
    matrix = hadamard(length)
    assert np.array_equal(matrix @ matrix.T, length * np.eye(length))


def test_row_1_never_changes_and_row_2_alternates() -> None:
    assert code(16, 2).tolist() == [1.0, -1.0] * 8
    assert code(16, 1).tolist() == [1.0] * 16


@pytest.mark.parametrize("length", [0, 3, 12, -4])
def test_other_lengths_are_refused(length: int) -> None:
    with pytest.raises(ValueError, match="power of two"):
        hadamard(length)
