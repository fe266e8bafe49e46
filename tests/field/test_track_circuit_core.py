"""The given recording of an onboard track-circuit signal, against the bits that it carries."""

from __future__ import annotations

import json
import os
from pathlib import Path

import msgspec
import numpy as np
import pytest

from services.track_circuit.profile import decode_profile
from services.track_circuit.receiver_choice import RECEIVERS
from services.track_circuit.receiver_demodulation import demodulate

FIELD = os.environ.get("KIROTEI_FIELD_DATA")
pytestmark = pytest.mark.skipif(not FIELD, reason="KIROTEI_FIELD_DATA names no folder of recordings")


@pytest.mark.parametrize("receiver", RECEIVERS)
@pytest.mark.parametrize("cut", [0, 4_321])
def test_every_bit_of_the_recording_is_received(receiver: str, cut: int) -> None:
    folder = Path(FIELD or "") / "track_circuit"
    meta = json.loads((folder / "syn_sscdma_12k_N16.sigmf-meta").read_text("utf-8"))["global"]
    profile = decode_profile(msgspec.json.encode(meta["trackcircuit:profile"]))
    samples = np.fromfile(folder / "syn_sscdma_12k_N16.sigmf-data", "<i2")[cut:] / 32768.0
    truth = np.array([int(bit) for bit in meta["trackcircuit:truth"]["data_bits"]], np.int8)
    found = demodulate(samples, float(meta["core:sample_rate"]), profile, receiver)
    assert np.array_equal(found.symbol, np.arange(found.symbol[0], 3000))
    assert found.symbol[0] == cut // 160  # one sample of symbol 27 is missing
    assert np.array_equal(found.bit, truth[found.symbol])
