"""One example of each of the track circuit messages."""

from __future__ import annotations

import numpy as np

from schemas.message import Message
from schemas.track_circuit import (
    CircuitEvent,
    CircuitHealth,
    CircuitOccupancy,
    ClearConfirmation,
    CodedCarrier,
    EqualiserState,
    SampleBlock,
    Telegram,
)
from tests.unit.schemas.example_time import T_NS

EXAMPLES: dict[type[Message], Message] = {
    SampleBlock: SampleBlock(
        t_ns=T_NS,
        first_sample=4800,
        sample_rate_hz=48_000.0,
        samples=np.array([0.5, -0.25], np.float32),
    ),
    Telegram: Telegram(
        t_ns=T_NS,
        circuit="T12",
        scheme="ss-cdma",
        state="good",
        sequence=17,
        circuit_id=12,
        payload=b"\x01\x02",
        crc_ok=True,
        evm_db=-15.0,
        level_db=-20.5,
        receiver="mlse",
    ),
    CodedCarrier: CodedCarrier(
        t_ns=T_NS,
        circuit="T12",
        state="good",
        carrier_hz=1701.4,
        code_hz=16.9,
        meaning="",
        level_db=-20.5,
        margin_db=18.0,
    ),
    EqualiserState: EqualiserState(
        t_ns=T_NS,
        circuit="T12",
        receiver="mlse",
        taps=np.array([1.0 + 0.5j, 0.25 - 0.125j]),
        error_db=np.array([-10.0, -15.0]),
        constellation=np.array([0.9 + 0.1j, -1.1 - 0.1j]),
        snr_db=15.0,
        carrier_offset_hz=0.5,
        clock_offset_ppm=-12.0,
        from_store=True,
    ),
    CircuitOccupancy: CircuitOccupancy(
        t_ns=T_NS,
        circuit="T12",
        state="occupied",
        reason="level 12.0 dB below the reference",
        level_db=-32.5,
        reference_db=-20.5,
        most_restrictive=True,
        since_ns=T_NS - 5_000_000_000,
    ),
    CircuitHealth: CircuitHealth(
        t_ns=T_NS,
        circuit="T12",
        level_db=-20.5,
        level_trend_db_per_day=-0.5,
        ballast_s_per_km=0.1,
        tap_drift=0.05,
        evm_db=-15.0,
        telegrams=120,
        crc_failures=3,
        stored_version=2,
    ),
    CircuitEvent: CircuitEvent(t_ns=T_NS, circuit="T12", kind="occupied", text="level fell by 12.0 dB", level_db=-32.5),
    ClearConfirmation: ClearConfirmation(t_ns=T_NS, circuit="T12", by="signaller"),
}
