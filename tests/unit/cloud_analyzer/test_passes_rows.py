"""History as passes.csv."""

from __future__ import annotations

from services.cloud_analyzer.passes_rows import COLUMNS, passes_of
from services.cloud_analyzer.tables import RADIO, rows_of
from tests.unit.cloud_analyzer.batches import NOW_NS, measurement


def test_rows_become_passes_and_what_has_no_place_direction_or_clock_is_left_out() -> None:
    records = [
        measurement(1),
        measurement(2, chainage_m=None),
        measurement(3, direction=None),
        measurement(4, t_ns=0),
        measurement(5, channel_power_dbm=None, decoded_power_dbm=-88.0),
        measurement(6, channel_power_dbm=None, decoded_power_dbm=None),
    ]
    columns, found = passes_of(RADIO.names, rows_of(records, NOW_NS, None).radio)
    assert columns == COLUMNS
    assert found == [
        ("2026-09-21T14:13:20.500000+00:00", "T1-0", "R1", "2412", "up", 6.25, -71.0, "", -71.0, *[None] * 5),
        ("2026-09-21T14:13:22.500000+00:00", "T1-0", "R0", "2412", "up", 31.25, -88.0, "", -88.0, *[None] * 5),
    ]
