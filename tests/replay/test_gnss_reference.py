"""A reference station, a train's receiver and its correction on one bus."""

from __future__ import annotations

import asyncio
from pathlib import Path

from schemas.codec import decode
from schemas.gnss import Corrections, Fix
from schemas.topic import Place
from schemas.topics import GNSS_CORRECTION, GNSS_FIX
from services.gnss_correction.service import SERVICE as CORRECTION
from services.gnss_correction.settings import Config
from services.gnss_receiver.observations import Navigation
from services.gnss_receiver.rinex_navigation_file import write_navigation
from services.gnss_receiver.rinex_observation_file import write_observations
from services.gnss_receiver.service import SERVICE as RECEIVER
from services.gnss_receiver.service import Config as ReceiverConfig
from services.gnss_reference.service import SERVICE as REFERENCE
from services.gnss_reference.service import Config as ReferenceConfig
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Sample
from tests.unit.gnss_correction.made_up_sky import START_S
from tests.unit.gnss_correction.test_differential import BASE_DEG, SKY, base, off_m, rover

TRAIN = Place("demo", "train", "T1")
WAYSIDE = Place("demo", "wayside", "W1")
START_NS = 1_700_000_000 * 10**9
BASE_EPOCHS, ROVER_EPOCHS = 6, 16
LONGEST_AGE_S = 5.0
EXACT_M = 0.1
"""RINEX rounds pseudoranges to a millimetre, and clocks of satellites and receivers to 0.1 microseconds: stamps shift
the satellites by some millimetres."""


def recorded(folder: Path) -> tuple[Path, Path, Path]:
    """Recordings of base and rover, and of what the satellites broadcast."""
    paths = folder / "base.obs", folder / "rover.obs", folder / "nav.rnx"
    write_observations(paths[0], [base(START_S + k) for k in range(BASE_EPOCHS)])
    write_observations(paths[1], [rover(START_S + k) for k in range(ROVER_EPOCHS)])
    write_navigation(paths[2], Navigation(tuple(SKY)))
    return paths


async def _run(folder: Path, reference: str) -> list[Sample]:
    """Everything that station and train say while both recordings are played at their own pace."""
    base_path, rover_path, navigation = recorded(folder)
    said: list[Sample] = []
    bus = MemoryBus(on_publish=said.append)
    clock = ManualClock(asyncio.get_running_loop(), START_NS)
    corrector = MemoryNode(bus, CORRECTION, TRAIN, clock)
    station = MemoryNode(bus, REFERENCE, WAYSIDE, clock)
    receiver = MemoryNode(bus, RECEIVER, TRAIN, clock)
    config = Config(method="original", compare=(), longest_correction_age_s=LONGEST_AGE_S, reference=reference)
    standing = ReferenceConfig(observations=str(base_path), navigation=(str(navigation),), position=BASE_DEG)
    driving = ReceiverConfig(observations=str(rover_path), navigation=(str(navigation),))
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(corrector.run(config))
        await corrector.is_ready.wait()
        tasks.create_task(station.run(standing))
        await receiver.run(driving)
        await asyncio.sleep(1.0)
        corrector.stop()
    return said


def played(folder: Path, reference: str = "") -> list[Sample]:
    return run_manual(_run(folder, reference))


def fixes(said: list[Sample]) -> list[Fix]:
    return [decode(Fix, one.payload) for one in said if one.key == GNSS_FIX.at(TRAIN, device="front")]


def test_a_train_is_corrected_while_the_station_speaks(tmp_path: Path) -> None:
    said = played(tmp_path)
    given = [decode(Corrections, one.payload) for one in said if one.key == GNSS_CORRECTION.at(WAYSIDE)]
    assert len(given) == BASE_EPOCHS
    assert {one.station for one in given} == {"W1"}
    answered = fixes(said)
    assert len(answered) == ROVER_EPOCHS
    # A receiver's first epoch may come before the station's first word.
    last = BASE_EPOCHS - 1 + int(LONGEST_AGE_S)
    corrected = answered[2 : last + 1]
    assert all(fix.satellites_corrected == fix.satellites_used for fix in corrected)
    assert max(off_m(fix) for fix in corrected) < EXACT_M
    stale = answered[last + 1 :]
    assert {fix.satellites_corrected for fix in stale} == {0}
    assert stale[0].reason == "no corrections: the last are 6 s old"
    assert min(off_m(fix) for fix in stale) > 1.0


def test_another_station_than_the_configured_one_is_not_listened_to(tmp_path: Path) -> None:
    answered = fixes(played(tmp_path, "W2"))
    assert {(fix.satellites_corrected, fix.reason) for fix in answered} == {(0, "")}


def test_the_same_recordings_give_the_same_bytes(tmp_path: Path) -> None:
    first, second = ([(one.key, one.payload) for one in played(tmp_path)] for _ in range(2))
    assert first == second
