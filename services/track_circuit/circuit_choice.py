"""On board: which circuit, and which stretch of it, the train's front end stands in."""

from __future__ import annotations

from schemas.position import TrainPosition
from services.track_circuit.settings import CircuitSettings


def circuit_at(circuits: tuple[CircuitSettings, ...], position: TrainPosition) -> tuple[str, float] | None:
    """Circuit under the front end and the distance from its sending end; None where none is known to be there."""
    axis_m = position.axis_m
    if position.status != "valid" or axis_m is None:
        return None
    for circuit in circuits:
        if circuit.sending_axis_m is None or circuit.length_m is None:
            continue
        distance_m = abs(axis_m - circuit.sending_axis_m)
        ahead = axis_m >= circuit.sending_axis_m
        if ahead == (circuit.receiving == "up") and distance_m <= circuit.length_m:
            return circuit.name, distance_m
    return None
