"""Passes and links to judge the watch of the radio on: recorded ones (KIROTEI_FIELD_DATA), else simulated ones."""

from __future__ import annotations

import csv
import gzip
from collections import defaultdict
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.radio_anomaly.passes import sorted_passes
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.settings import Settings
from services.simulator.radio_passes import radio_passes, world_of
from services.simulator.radio_scenario import RadioScenario, radio_scenario_from_toml
from services.simulator.scenario_file import radio_line_for

Pass = list[Reading]
DAY_NS = 86_400 * 10**9
FLOOR_DBM = -95.0
"""Noise floor of the cards of ORBIT, above which their RSSI counts."""
ERROR_RSSI = 128


def road_passes(path: Path) -> list[Pass]:
    """cork_road/passes.csv.gz, as score/radio.py hands it over."""
    found = []
    with gzip.open(path, "rt", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            when = datetime.fromisoformat(row["time"]).replace(tzinfo=UTC)
            found.append(
                Reading(
                    t_ns=int(when.timestamp()) * 10**9,
                    pass_id=row["pass_id"],
                    radio="ue1",
                    channel="nr-lte" if row["mode"] in ("5G", "LTE") else "umts-gsm",
                    direction="up" if row["dir"] == "up" else "down",
                    chainage_m=float(row["chainage_m"]),
                    power_dbm=float(row["rsrp_dbm"]),
                    cell=row["cell"],
                )
            )
    return sorted_passes(found, Settings())[0]


def simulated(name: str, days: int, radios: Sequence[str] = ()) -> list[Pass]:
    """Passes of a scenario that comes with the simulator, over its first days, of some of its radios or of all."""
    text = resources.files("services.simulator").joinpath("scenarios", f"{name}.toml").read_text("utf-8")
    scenario = radio_scenario_from_toml(text)
    passes = msgspec.structs.replace(scenario.passes, days=days)
    radio = msgspec.structs.replace(scenario.radio, period_s=1.0)
    found = scenario_passes(msgspec.structs.replace(scenario, passes=passes, radio=radio))
    return [[one for one in each if not radios or one.radio in radios] for each in found]


def scenario_passes(scenario: RadioScenario) -> list[Pass]:
    """Every pass of a scenario as readings."""
    line, chainage = radio_line_for(scenario)
    world = world_of(scenario, line)
    found = []
    for one in radio_passes(scenario, world, chainage):
        readings = []
        for k in range(len(one.t_ns)):
            link = world.links[int(one.link[k])]
            readings.append(
                Reading(
                    t_ns=int(one.t_ns[k]),
                    pass_id=one.pass_id,
                    radio=world.line.sites[link.site].id,
                    channel=link.channel,
                    direction=one.direction,
                    chainage_m=float(one.chainage_m[k]),
                    power_dbm=_known(one.measured["channel_power_dbm"], k),
                    decoded_power_dbm=_known(one.measured["decoded_power_dbm"], k),
                    received_ratio=_known(one.measured["received_ratio"], k),
                    corrected_bits=_known(one.measured["corrected_bits"], k),
                )
            )
        found.append(readings)
    return found


def _known(column: NDArray[np.float64], k: int) -> float | None:
    return float(column[k]) if np.isfinite(column[k]) else None


def other_splits(passes: Sequence[Pass]) -> dict[str, tuple[list[Pass], list[Pass]]]:
    """By name: passes learned, and passes judged, which then come days after those.

    The halves the other way round, and every second pass, either way.
    """
    half = len(passes) // 2
    ways = {
        "later half learned": (list(passes[half:]), passes[:half]),
        "odd passes learned": (list(passes[1::2]), passes[::2]),
        "even passes learned": (list(passes[::2]), passes[1::2]),
    }
    days = (passes[-1][-1].t_ns - passes[0][0].t_ns) // DAY_NS + 2
    return {
        name: (
            learned,
            [[msgspec.structs.replace(one, t_ns=one.t_ns + days * DAY_NS) for one in each] for each in judged],
        )
        for name, (learned, judged) in ways.items()
    }


def redated(passes: Sequence[Pass], number: int, begin_ns: int) -> Pass:
    """A drawn pass as the `number`-th of a series with two a day, under a name of its own."""
    drawn = passes[0]
    start_ns = begin_ns + number // 2 * DAY_NS + (number % 2) * 8 * 3_600 * 10**9
    shift_ns = start_ns - drawn[0].t_ns
    return [msgspec.structs.replace(one, t_ns=one.t_ns + shift_ns, pass_id=f"{number:04d}") for one in drawn]


Frames = dict[int, dict[tuple[str, str], list[tuple[int, int]]]]
"""By noise [dBm], then by sender and receiver: number of each frame heard and its RSSI."""


def orbit_frames(path: Path) -> Frames:
    """orbit_noise/links.csv.gz."""
    found: Frames = defaultdict(lambda: defaultdict(list))
    with gzip.open(path, "rt", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            found[int(row["noise_dbm"])][(row["tx"], row["rx"])].append((int(row["seq"]), int(row["rssi"])))
    return found


def orbit_stretch(frames: Frames, noise_dbm: int, number: int, length: int, links: Sequence[tuple[str, str]]) -> Pass:
    """A stretch of frames on every link as one period at a site: decoded power, and reception ratio.

    Frames with the error code, and those that never came, are lost ones.
    """
    begin_ns = 1_700_000_000 * 10**9 + (number + 1000 * (noise_dbm == 0)) * 600 * 10**9
    found = []
    for sender, receiver in links:
        heard = [
            rssi
            for seq, rssi in frames[noise_dbm].get((sender, receiver), [])
            if number * length <= seq < (number + 1) * length and rssi != ERROR_RSSI
        ]
        ratio = min(len(heard) / length, 1.0)
        powers: list[float | None] = [FLOOR_DBM + rssi for rssi in heard] or [None, None]
        found += [
            Reading(
                t_ns=begin_ns + k * 10**9,
                pass_id=f"{noise_dbm}/{number}",
                radio=f"{sender}>{receiver}",
                channel="wifi",
                decoded_power_dbm=power,
                received_ratio=ratio,
            )
            for k, power in enumerate(powers)
        ]
    return sorted(found, key=lambda one: one.t_ns)
