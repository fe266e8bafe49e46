"""Epochs of one receiver as the columns of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.gnss import Epoch
from services.gnss_receiver.observations import Observations, satellite_code


def observations_of(epochs: Sequence[Epoch]) -> Observations:
    """Recording that holds `epochs` in their order."""
    signals = tuple(sorted({signal for epoch in epochs for signal in epoch.signals}))
    number = {signal: i for i, signal in enumerate(signals)}

    def column(name: str, dtype: type[np.generic] = np.float64) -> NDArray[Any]:
        columns = [getattr(epoch, name) for epoch in epochs]
        return np.concatenate([np.zeros(0, dtype), *columns]).astype(dtype)

    return Observations(
        gps_week=np.array([epoch.gps_week for epoch in epochs], dtype=np.int64),
        tow_s=np.array([epoch.tow_s for epoch in epochs], dtype=np.float64),
        first_row=np.cumsum([0, *(len(epoch.satellites) for epoch in epochs)], dtype=np.int64),
        satellite=np.array([satellite_code(name) for epoch in epochs for name in epoch.satellites], dtype=np.uint16),
        signal=np.array([number[signal] for epoch in epochs for signal in epoch.signals], dtype=np.uint8),
        signals=signals,
        pseudorange_m=column("pseudorange_m"),
        carrier_phase_cycles=column("carrier_phase_cycles"),
        doppler_hz=column("doppler_hz"),
        cn0_dbhz=column("cn0_dbhz"),
        lock_lost=column("lock_lost", np.uint8),
    )
