"""Equaliser and condition of a circuit as they are told on the bus."""

from __future__ import annotations

from typing import Final

import numpy as np

from schemas.track_circuit import CircuitHealth, EqualiserState
from services.track_circuit.circuit_following import LivePiece
from services.track_circuit.demodulator_choice import receiver_used
from services.track_circuit.health import HealthTrend
from services.track_circuit.rail import Rail, ballast_estimate
from services.track_circuit.settings import CircuitSettings

SHOWN_POINTS: Final = 64


def equaliser_state(
    settings: CircuitSettings, piece: LivePiece | None, t_ns: int, *, from_store: bool, refused: str
) -> EqualiserState:
    """The latest burst's equaliser; empty where the receiver refused to work."""
    none = np.empty(0)
    return EqualiserState(
        t_ns=t_ns,
        circuit=settings.name,
        receiver=receiver_used(settings.profile, settings.receiver),
        taps=none.astype(np.complex128) if piece is None else piece.taps.ravel(),
        error_db=none if piece is None else piece.error_db,
        constellation=none.astype(np.complex128) if piece is None else piece.constellation[-SHOWN_POINTS:],
        snr_db=None if piece is None else -piece.evm_db,
        carrier_offset_hz=0.0 if piece is None else piece.carrier_offset_hz,
        clock_offset_ppm=0.0 if piece is None else piece.clock_offset_ppm,
        from_store=from_store,
        refused=refused,
    )


def circuit_health(
    settings: CircuitSettings, health: HealthTrend, stored_version: int | None, t_ns: int
) -> CircuitHealth:
    """Condition, with the leakage that the level speaks for where the circuit's length is known."""
    ballast = None
    if settings.length_m is not None and health.level_db is not None and health.driest_db is not None:
        profile = settings.profile
        hz = profile.carriers_hz[0] if profile.scheme == "fsk" else profile.carrier_hz
        ballast = ballast_estimate(Rail(), hz, settings.length_m / 1000.0, health.level_db, health.driest_db)
    return CircuitHealth(
        t_ns=t_ns,
        circuit=settings.name,
        level_db=health.level_db,
        level_trend_db_per_day=health.trend_db_per_day(),
        ballast_s_per_km=ballast,
        tap_drift=health.tap_drift,
        evm_db=health.evm_db,
        telegrams=health.telegrams,
        crc_failures=health.crc_failures,
        stored_version=stored_version,
    )
