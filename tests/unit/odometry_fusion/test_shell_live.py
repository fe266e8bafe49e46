"""What stands between blocks on the bus and the methods: buffers, axles, state on disk."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from schemas.motion import ImuBlock, Odometry, TachoBlock
from services.odometry_fusion.axle_choice import AxleChoice
from services.odometry_fusion.live_odometry import LiveOdometry
from services.odometry_fusion.methods import run_log
from services.odometry_fusion.motion_log import MotionLog, Remembered
from services.odometry_fusion.odometry_store import StoreError, read_state, state_file, write_state
from services.odometry_fusion.sample_buffer import SampleBuffer
from services.odometry_fusion.settings import Config
from tests.unit.odometry_fusion.test_paper_runs import CONFIG, errors_of, run_of

START_NS = 1_800_000_000_000_000_000


def blocks_of(log: MotionLog, *, axle: str = "a1", every_s: float = 0.1) -> list[tuple[ImuBlock | TachoBlock, str]]:
    """A log as blocks with their devices, in order of time."""
    found: list[tuple[float, int, ImuBlock | TachoBlock, str]] = []
    imu_ns, tacho_ns = (np.rint(t_s * 1e9).astype(np.int64) + START_NS for t_s in (log.imu_t_s, log.tacho_t_s))
    for first_s in np.arange(0.0, log.end_s + every_s, every_s):
        first_ns, last_ns = (START_NS + round(t_s * 1e9) for t_s in (first_s, first_s + every_s))
        for times_ns, rank in ((imu_ns, 0), (tacho_ns, 1)):
            at = np.flatnonzero((times_ns >= first_ns) & (times_ns < last_ns))
            if not len(at):
                continue
            t_ns, first = int(times_ns[at[-1]]), int(at[0])
            offset_ns = times_ns[at] - t_ns
            block: ImuBlock | TachoBlock
            if rank == 0:
                ax, ay, az, gx, gy, gz = (np.ascontiguousarray(log.imu[at, k]) for k in range(6))
                block = ImuBlock(
                    t_ns=t_ns,
                    first_sample=first,
                    offset_ns=offset_ns,
                    ax_mps2=ax,
                    ay_mps2=ay,
                    az_mps2=az,
                    gx_radps=gx,
                    gy_radps=gy,
                    gz_radps=gz,
                )
            else:
                block = TachoBlock(
                    t_ns=t_ns,
                    first_sample=first,
                    offset_ns=offset_ns,
                    pulses=log.pulses[at],
                    pulses_per_revolution=log.pulses_per_revolution,
                    wheel_diameter_m=log.wheel_diameter_m,
                )
            found.append((first_s, rank, block, "imu" if rank == 0 else axle))
    return [(block, device) for _, _, block, device in sorted(found, key=lambda one: one[:2])]


def told(live: LiveOdometry, blocks: list[tuple[ImuBlock | TachoBlock, str]]) -> list[Odometry]:
    messages = [one for block, device in blocks for one in live.take(block, device)]
    return [one for one in messages if isinstance(one, Odometry)]


LIVE = Config(method="paper", imu_latency_s=0.3, imu_rest_mps2=0.09, imu_rest_radps=1.4e-3)
"""As much as the sensor of the made-up runs shows at rest."""


def test_late_repeated_and_broken_samples_are_counted_and_left_out() -> None:
    log, _, _ = run_of()
    blocks = [block for block, _ in blocks_of(log)[:12] if isinstance(block, ImuBlock)]
    counts: Counter[str] = Counter()
    buffer = SampleBuffer("imu", counts)
    for block in (blocks[0], blocks[0], blocks[2], blocks[1], blocks[4]):
        buffer.add_imu(block)
    times_ns, values = buffer.take()
    assert len(times_ns) == 30
    assert sum(len(one) for one in values) == 30
    assert counts == {"imu_late_or_repeated": 20, "imu_samples_missing": 30}
    assert len(buffer.take()[0]) == 0


def test_a_clock_that_is_set_back_begins_a_new_origin() -> None:
    log, _, _ = run_of()
    blocks = blocks_of(log)
    live = LiveOdometry(LIVE, "T1", 3, None)
    first = told(live, blocks[:400])
    again = told(live, blocks[:400])
    assert {one.origin for one in first} == {"T1-3.1"}
    assert "T1-3.2" in {one.origin for one in again}
    assert live.counts["begun_anew"] == 1


def test_a_wheel_that_is_turned_begins_a_new_origin() -> None:
    log, _, _ = run_of()
    live = LiveOdometry(LIVE, "T1", 1, None)
    told(live, blocks_of(log)[:300])
    told(live, blocks_of(replace(log, wheel_diameter_m=0.8))[300:600])
    assert live.origin == "T1-1.2"


def test_two_axles_the_one_that_slips_does_not_lead() -> None:
    slipping, t_s, distance_m = run_of(slip_mps=5.0)
    steady, _, _ = run_of()
    rows = AxleChoice().advance([run_log(slipping, CONFIG), run_log(steady, CONFIG)])
    alone = run_log(steady, CONFIG)
    # The steady axle takes over from 10 s before the slip was seen: nothing of the slip is left.
    assert np.abs(errors_of(rows, t_s, distance_m)[rows.t_s > 80.0]).max() < 0.6
    assert rows.distance_m[-1] == pytest.approx(alone.distance_m[-1], abs=0.1)
    assert (np.diff(rows.way_m) >= 0.0).all()
    assert (np.diff(rows.excess_m) >= 0.0).all()
    assert not rows.slip[rows.t_s > 72.0].any()


def test_axles_are_heard_together_whatever_their_order() -> None:
    slipping, t_s, distance_m = run_of(slip_mps=5.0)
    steady, _, _ = run_of()
    second = [one for one in blocks_of(steady, axle="a2") if one[1] == "a2"]
    mixed = sorted([*blocks_of(slipping), *second], key=lambda one: one[0].t_ns)
    live = LiveOdometry(LIVE, "T1", 1, None)
    rows = told(live, mixed)
    error_m = rows[-1].distance_m - rows[0].distance_m - (distance_m[-1] - np.interp(0.1, t_s, distance_m))
    assert abs(error_m) < 0.6
    assert live.devices == ("imu", "a2")


def test_silence_is_told_and_the_bound_grows() -> None:
    log, _, _ = run_of()
    live = LiveOdometry(LIVE, "T1", 1, None)
    rows = told(live, blocks_of(log)[:1000])
    assert rows[-1].status == "valid"
    assert live.silent(0.5) == []
    later = [one for one in live.silent(4.0) if isinstance(one, Odometry)]
    assert later[-1].status == "lost"
    assert later[-1].bound_m > rows[-1].bound_m + 5.0
    assert (np.diff([one.t_ns for one in later]) == 100_000_000).all()


def test_state_comes_back_whole_or_not_at_all(tmp_path: Path) -> None:
    path = state_file(tmp_path, "line/1", "T 1")
    assert read_state(path) == (0, None)
    known = Remembered(1e-4, -2e-4, 3e-4, 0.987)
    write_state(path, 7, known)
    assert read_state(path) == (7, known)
    write_state(path, 8, None)
    assert read_state(path) == (8, None)
    path.write_bytes(path.read_bytes().replace(b"8", b"9"))
    with pytest.raises(StoreError, match="damaged"):
        read_state(path)
    assert [one.name for one in path.parent.iterdir()] == [path.name]
