"""Passes over a made-up line, the same for the same numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime

import msgspec
import numpy as np

from services.radio_anomaly.passes import Journey, binned
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.settings import Settings

BEGIN_NS = 1_767_600_000 * 10**9
"""2026-01-05T08:00:00Z."""
DAY_NS = 86_400 * 10**9
SECTIONS = 40
SETTINGS = Settings()


def mean_dbm(section: int) -> float:
    """Power of a section: two radios' worth of hills."""
    return -75.0 - 12.0 * math.sin(section / 5.0)


def one_pass(
    number: int,
    *,
    change_db: float = 0.0,
    stretch: tuple[int, int] = (0, SECTIONS),
    ratio: float | None = None,
    spread_db: float = 1.5,
    silent: Sequence[int] = (),
    radio: str = "W1",
) -> list[Reading]:
    """The `number`-th pass, two a day, up and down in turn; three samples in every section."""
    generator = np.random.default_rng([number, 7])
    up = number % 2 == 0
    start_ns = BEGIN_NS + number // 2 * DAY_NS + number % 2 * 30_000 * 10**9
    found = []
    order = range(SECTIONS) if up else reversed(range(SECTIONS))
    for step, section in enumerate(order):
        between_db = float(generator.normal(0.0, spread_db))
        off_db = change_db if stretch[0] <= section < stretch[1] else 0.0
        for k in range(3):
            if section in silent:
                continue
            place_m = section * 100.0 + 20.0 + 30.0 * (k if up else 2 - k)
            found.append(
                Reading(
                    t_ns=start_ns + (step * 8 + 2 * k) * 10**9,
                    pass_id=f"P{number:03d}",
                    radio=radio,
                    channel="ch1",
                    direction="up" if up else "down",
                    chainage_m=place_m,
                    power_dbm=mean_dbm(section) + between_db + off_db,
                    received_ratio=ratio,
                )
            )
    return found


def journeys(count: int, begin: int = 0) -> list[Journey]:
    """Normal passes, binned."""
    return [binned(one_pass(number), SETTINGS) for number in range(begin, begin + count)]


def csv_of(readings: Sequence[Reading]) -> str:
    """passes.csv of readings."""

    lines = ["time,pass_id,radio,channel,direction,chainage_m,power_dbm"]
    for one in readings:
        when = datetime.fromtimestamp(one.t_ns / 1e9, UTC).isoformat()
        lines.append(
            f"{when},{one.pass_id},{one.radio},{one.channel},{one.direction},{one.chainage_m},{one.power_dbm:.3f}"
        )
    return "\n".join(lines) + "\n"


def at(reading: Reading, **changes: object) -> Reading:
    """A reading with fields changed."""
    return msgspec.structs.replace(reading, **changes)
