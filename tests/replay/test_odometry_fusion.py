"""The odometry service on a bus in memory: the same rows as a file run gives, through late and repeated blocks."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from schemas.motion import ImuBlock, Odometry, SlipEpisode, TachoBlock, WheelScale
from schemas.topic import Place
from schemas.topics import IMU, ODOMETRY, SLIP_EPISODE, TACHO, WHEEL_SCALE
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.row_messages import episode_of, odometry_of
from services.odometry_fusion.service import SERVICE
from services.odometry_fusion.settings import Config
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from tests.unit.odometry_fusion.test_paper_runs import CONFIG, run_of
from tests.unit.odometry_fusion.test_shell_live import START_NS, blocks_of

TRAIN = Place("demo", "train", "T1")
WRITER = guest("writer", "speaks", writes=(IMU, TACHO, WHEEL_SCALE))
READER = guest("reader", "hears", reads=(ODOMETRY, SLIP_EPISODE))


class Heard:
    """What a run of the service gave."""

    def __init__(self) -> None:
        self.rows: list[Odometry] = []
        self.episodes: list[SlipEpisode] = []
        self.counts: dict[str, int] = {}


def served(
    blocks: list[tuple[ImuBlock | TachoBlock, str]],
    config: Config,
    *,
    silence_s: float = 0.0,
    scale: WheelScale | None = None,
) -> Heard:
    """Everything that the service says to blocks, each at its time."""
    found = Heard()

    async def hear(node: MemoryNode) -> None:
        async for message in node.messages(ODOMETRY, SLIP_EPISODE):
            match message:
                case Odometry():
                    found.rows.append(message)
                case SlipEpisode():
                    found.episodes.append(message)

    async def main() -> None:
        clock = ManualClock(asyncio.get_running_loop(), START_NS)
        bus = MemoryBus()
        writer, reader, node = (MemoryNode(bus, service, TRAIN, clock) for service in (WRITER, READER, SERVICE))
        listening = asyncio.ensure_future(hear(reader))
        running = asyncio.ensure_future(node.run(config))
        await node.is_ready.wait()
        untold = [] if scale is None else [scale]
        for block, device in blocks:
            await asyncio.sleep(max(0.0, (block.t_ns - clock.now_ns()) * 1e-9))
            if untold and block.t_ns >= untold[0].t_ns:
                await writer.publish(WHEEL_SCALE, untold.pop())
            if isinstance(block, ImuBlock):
                await writer.publish(IMU, block, device=device)
            else:
                await writer.publish(TACHO, block, device=device)
        await asyncio.sleep(silence_s + 0.01)
        node.stop()
        await running
        found.counts = dict(node.health.counts)
        reader.stop()
        await listening

    run_manual(main())
    return found


LIVE = Config(method="paper", imu_latency_s=0.3, imu_rest_mps2=0.09, imu_rest_radps=1.4e-3)
"""As much as the sensor of the made-up runs shows at rest."""


def test_live_rows_are_those_of_a_file() -> None:
    log, _, _ = run_of(slip_mps=4.0, gradient=0.01)
    heard = served(blocks_of(log), LIVE)
    rows = run_log(log, CONFIG)
    base_ns = START_NS + round(log.tacho_t_s[0] * 1e9)
    # Files count time from the log's zero, the service from the first count.
    shift_ns = base_ns - round(rows.t_s[0] * 1e9)
    wanted = [odometry_of(rows, at, shift_ns, "paper", "T1-1.1") for at in range(len(heard.rows))]
    assert len(heard.rows) >= len(rows) - 1
    assert heard.rows == wanted
    assert heard.episodes == [episode_of(one, shift_ns, "T1-1.1") for one in rows.episodes]


def test_a_wheel_that_stands_while_the_train_is_shaken_is_not_vouched_for() -> None:
    log, _, _ = run_of()
    shaken_s, end_s = 20.0, 30.0
    generator = np.random.default_rng(1)
    under_way = (log.imu_t_s < shaken_s)[:, None] * np.array([0.15] * 3 + [0.0015] * 3)
    locked = replace(
        log,
        imu=log.imu[:1] + generator.normal(0.0, 1.0, log.imu.shape) * (under_way + np.array([0.01] * 3 + [1e-4] * 3)),
        pulses=np.zeros_like(log.pulses),
    )
    heard = served([one for one in blocks_of(locked) if one[0].t_ns < START_NS + end_s * 1e9], LIVE)
    sliding = [one for one in heard.rows if one.t_ns < START_NS + shaken_s * 1e9]
    assert {one.status for one in sliding} == {"degraded"}
    assert not any(one.standstill for one in sliding)
    assert "it may be locked" in sliding[0].reason
    # A train of 100 m/s, for as long as the wheel has stood so; the first count comes after the first samples.
    assert sliding[-1].excess_m == pytest.approx(100.0 * shaken_s, abs=100.0)
    assert sliding[-1].bound_m > sliding[-1].excess_m
    resting = heard.rows[-1]
    assert (resting.status, resting.standstill, resting.origin) == ("valid", True, "T1-1.2")
    assert resting.excess_m < 1.0


def test_late_and_repeated_blocks_change_nothing_but_the_counts() -> None:
    log, _, _ = run_of(slip_mps=4.0)
    blocks = blocks_of(log)[:1800]
    rng = np.random.default_rng(3)
    untidy = [one for block in blocks for one in ([block, block] if rng.random() < 0.2 else [block])]
    plain, heard = served(blocks, LIVE), served(untidy, LIVE)
    assert heard.rows == plain.rows
    assert heard.counts["imu_late_or_repeated"] > 100


def test_silence_goes_on_with_rows_that_say_so() -> None:
    log, _, _ = run_of()
    heard = served(blocks_of(log)[:600], LIVE, silence_s=5.0)
    assert heard.rows[-1].status == "lost"
    steps_ns = np.diff([one.t_ns for one in heard.rows])
    assert (steps_ns == 100_000_000).all()
    assert heard.rows[-1].t_ns - blocks_of(log)[599][0].t_ns > 3_000_000_000


def test_state_survives_a_restart_and_names_a_new_origin(tmp_path: Path) -> None:
    log, _, _ = run_of()
    config = msgspec.structs.replace(LIVE, state_folder=str(tmp_path))
    first, second = served(blocks_of(log)[:200], config), served(blocks_of(log)[300:500], config)
    assert first.rows[-1].origin == "T1-1.1"
    assert second.rows[0].origin == "T1-2.1"
    learned = first.rows[-1].gyro_bias_radps
    assert learned is not None
    assert learned != 0.0
    # Under way from its first sample on, the second run has nothing else to go by.
    assert second.rows[0].gyro_bias_radps == learned


def test_a_scale_told_by_references_is_used_at_once_and_kept_for_the_next_start(tmp_path: Path) -> None:
    log, _, _ = run_of()
    config = Config(method="fused", imu_latency_s=0.3, state_folder=str(tmp_path))
    blocks = blocks_of(log)
    told = WheelScale(t_ns=blocks[400][0].t_ns, scale=0.99, sigma=0.001, references=2)
    plain, first = served(blocks[:800], config), served(blocks[:800], config, scale=told)
    assert first.rows[0].wheel_scale is None
    assert first.rows[-1].wheel_scale == 0.99
    # 2.2 % for micro-slip that is not seen and three standard deviations, instead of 3 % for a wheel that nobody knows.
    assert (plain.rows[-1].share_bound, first.rows[-1].share_bound) == pytest.approx((0.03, 0.025))
    after = [one.t_ns > told.t_ns + 1_000_000_000 for one in first.rows]
    at = after.index(True)
    gone_m, known_m = (rows[-1].distance_m - rows[at].distance_m for rows in (plain.rows, first.rows))
    assert known_m == pytest.approx(0.99 * gone_m, rel=1e-6)
    # What the former share left in the bound stays owed to the origin, and is no excess of a slip.
    assert first.rows[-1].excess_m == pytest.approx(plain.rows[-1].excess_m, abs=0.01)
    second = served(blocks[800:1200], config)
    assert second.rows[-1].wheel_scale == 0.99
    # Wheels may have been turned meanwhile: until a reference tells, all of wear is vouched for.
    assert second.rows[-1].share_bound == pytest.approx(0.03)


def test_an_absurd_scale_is_refused_and_counted() -> None:
    log, _, _ = run_of()
    blocks = blocks_of(log)[:400]
    told = WheelScale(t_ns=blocks[200][0].t_ns, scale=1.5, sigma=0.001, references=2)
    heard = served(blocks, Config(method="fused", imu_latency_s=0.3), scale=told)
    assert heard.rows[-1].wheel_scale is None
    assert heard.counts["wheel_scale_refused"] == 1


def test_the_wheel_alone_is_served_too() -> None:
    log, _, _ = run_of()
    heard = served([one for one in blocks_of(log)[:1000] if isinstance(one[0], TachoBlock)], Config(method="wheel"))
    assert len(heard.rows) > 480
    assert {one.method for one in heard.rows} == {"wheel"}
