"""Offline replay: a receiver's recording through gnss_correction, in multiples of real time.

The log is first laid into an MCAP recording by the receiver's own service in virtual time; what
is measured is the command that a user types, and the run inside it without start and imports.
"""

from __future__ import annotations

import json as json_text
import statistics
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.bus import machine
from benchmarks.comparison import seconds
from benchmarks.gnss import logs
from schemas.gnss_time import unix_ns_from_gps
from schemas.topic import Place
from services.gnss_receiver.rinex_observation_file import read_observations
from services.gnss_receiver.service import SERVICE as RECEIVER
from services.gnss_receiver.service import Config as ReceiverConfig
from services.recorder.service import SERVICE as RECORDER
from services.recorder.service import Config as RecorderConfig
from services.runtime.clock import ManualClock
from services.runtime.manual_loop import manual_loop
from services.runtime.memory_node import MemoryBus, MemoryNode

ROUNDS = 5
TRAIN = Place("bench", "train", "T1")


@dataclass(frozen=True, slots=True)
class Speed:
    """How fast a log was replayed."""

    log: str
    epochs: int
    recorded_s: float
    run_s: float
    """Median, start and imports apart."""
    command_s: float
    """Median of the whole command."""

    @property
    def times_real(self) -> float:
        """Recorded seconds per second of the run."""
        return self.recorded_s / self.run_s


def record(rover: Path, navigation: tuple[Path, ...], folder: Path) -> Path:
    """Recording of a receiver's log, made in virtual time."""
    observations = read_observations(rover)
    start_ns = unix_ns_from_gps(int(observations.gps_week[0]), float(observations.tow_s[0]))
    span_s = float(observations.tow_s[-1] - observations.tow_s[0])
    settings = ReceiverConfig(observations=str(rover), navigation=tuple(map(str, navigation)))
    with manual_loop() as loop:
        bus, clock = MemoryBus(), ManualClock(loop, start_ns)
        recorder = MemoryNode(bus, RECORDER, TRAIN, clock)
        receiver = MemoryNode(bus, RECEIVER, TRAIN, clock)
        tasks = [
            loop.create_task(recorder.run(RecorderConfig(folder=str(folder), fsync=False))),
            loop.create_task(receiver.run(settings)),
        ]
        loop.advance(span_s + 5.0)
        for node in (receiver, recorder):
            node.stop()
            loop.settle()
        for task in tasks:
            task.result()
    (path,) = folder.glob("*.mcap")
    return path


def replay_once(recording: Path, out: Path) -> float:
    """How long the replay inside the command took [s]."""
    command = [str(Path(sys.executable).with_name("kirotei")), "replay", str(recording)]
    command += ["--through", "gnss_correction", "--out", str(out), "--json"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    out.unlink()
    took_s: float = json_text.loads(done.stdout)["took_s"]
    return took_s


def run(*, json: bool = False, rounds: int = ROUNDS) -> Speed:
    """Measure, print (or JSON) and give the result."""
    about = machine()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = logs(folder)[0]
        (folder / "recordings").mkdir()
        recording = record(log.rover, log.navigation, folder / "recordings")
        observations = read_observations(log.rover)
        replay_once(recording, folder / "out.mcap")
        runs: list[float] = []
        commands = [seconds(lambda: runs.append(replay_once(recording, folder / "out.mcap"))) for _ in range(rounds)]
    speed = Speed(
        log.name,
        len(observations),
        float(observations.tow_s[-1] - observations.tow_s[0]),
        statistics.median(runs),
        statistics.median(commands),
    )
    if json:
        found = {"machine": about, **asdict(speed), "times_real": speed.times_real}
        sys.stdout.write(json_text.dumps(found, indent=2) + "\n")
    else:
        sys.stdout.write(
            f"{about}\nreplay of {log.name} through gnss_correction, medians of {rounds}: {speed.recorded_s:.0f} s in "
            f"{speed.run_s:.2f} s = {speed.times_real:.0f} x real time ({speed.command_s:.2f} s as a whole command)\n"
        )
    return speed
