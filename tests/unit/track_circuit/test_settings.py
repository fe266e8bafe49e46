"""Settings: what contradicts itself is refused by name."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from services.simulator.track_circuit_settings import TrackCircuitSettings
from services.track_circuit.settings import Config


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"circuits": [{"name": "a"}, {"name": "a"}]}, "same name"),
        ({"circuits": [{"name": "a", "alsa": {}, "file": {"path": "x"}}]}, "alsa or file"),
        ({"circuits": [{"name": "a", "profile": {"ch1_row": 2, "ch2_row": 2}}]}, "ch1_row and ch2_row"),
        ({"circuits": [{"name": "a", "alsa": {"device": "x; rm"}}]}, "device"),
        ({"circuits": [{"name": "a", "receiver": "best"}]}, "receiver"),
        ({"code_table": {"codes": []}}, "codes"),
        ({"circuit": []}, "circuit"),
    ],
)
def test_contradictions_are_refused(table: dict[str, Any], words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(table, Config)


def test_plain_settings_are_enough() -> None:
    config = msgspec.convert({"circuits": [{"name": "T12", "circuit_id": 12}]}, Config)
    assert config.circuits[0].profile.framing is not None
    assert config.circuits[0].receiver == "mlse"


def test_simulated_weather_needs_times_in_order() -> None:
    points = [{"t_s": 5.0, "s_per_km": 0.1}, {"t_s": 1.0, "s_per_km": 0.1}]
    with pytest.raises(msgspec.ValidationError, match="rising"):
        msgspec.convert({"ballast": points}, TrackCircuitSettings)
