"""GNSS files: reading RINEX beside georinex, streams beside pyrtcm and pyubx2, positions beside rnx2rtkp.

Rounds alternate between the two sides and medians are compared. Kirotei is timed inside a
running process that has done the same once before (kernels compiled), and as a whole command;
rnx2rtkp always as a whole command, which costs it a few milliseconds of start.

Peers: `make bench` puts georinex into .venv-peers; rnx2rtkp comes with Debian's rtklib.
Files: the Berlin, static and Shanghai logs where KIROTEI_FIELD_DATA names their folder, else a
simulated run.
"""

from __future__ import annotations

import json as json_text
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.bus import machine
from benchmarks.comparison import Result, alternate, seconds, table
from benchmarks.gnss_streams import measure_streams
from schemas.codec import encode
from schemas.gnss import Method
from services.gnss_correction.fix_messages import fixes_of
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.settings import Config
from services.gnss_correction.verdict_messages import verdicts_of
from services.gnss_receiver.rinex_navigation_file import read_navigation
from services.gnss_receiver.rinex_observation_file import read_observations
from services.simulator.scenario_file import read_scenario
from services.simulator.simulation_file import write_simulation

ROUNDS = 5
PEER_LIMIT_S = 60.0
ROOT = Path(__file__).parents[1]
PEER_PYTHON = ROOT / ".venv-peers" / "bin" / "python"
GEORINEX = """
import sys, time, warnings
warnings.simplefilter("ignore")
import georinex
started = time.perf_counter()
georinex.load(sys.argv[1])
print(time.perf_counter() - started)
"""


@dataclass(frozen=True, slots=True)
class Log:
    """An observation file and the navigation files that go with it."""

    name: str
    rover: Path
    navigation: tuple[Path, ...]


def logs(folder: Path) -> list[Log]:
    """What can be measured here; a simulated run is written into `folder`."""
    field = os.environ.get("KIROTEI_FIELD_DATA")
    if field and (Path(field) / "gnss").is_dir():
        gnss = Path(field) / "gnss"
        berlin, static, shanghai = gnss / "berlin_5hz", gnss / "static_dgps", gnss / "shanghai_dgps"
        return [
            Log("Berlin 5 Hz (RINEX 2.11)", berlin / "rover.obs", (berlin / "nav_gps.16n",)),
            Log("static 1 Hz (RINEX 3.04)", static / "rover.obs", (static / "nav.rnx",)),
            Log("Shanghai 1 Hz (RINEX 3.04)", shanghai / "rover.obs", (shanghai / "nav.rnx",)),
        ]
    write_simulation(read_scenario("street_canyon"), folder)
    return [Log("simulated 5 Hz (RINEX 3.04)", folder / "rover.obs", (folder / "nav.rnx",))]


def georinex_s(log: Log) -> float:
    """How long georinex takes to read the file, its start and imports apart [s]; NaN past a minute."""
    try:
        done = subprocess.run(
            [str(PEER_PYTHON), "-c", GEORINEX, str(log.rover)],
            capture_output=True,
            text=True,
            check=True,
            timeout=PEER_LIMIT_S,
        )
    except subprocess.TimeoutExpired:
        return float("nan")
    return float(done.stdout.split()[-1])


def rnx2rtkp_s(log: Log) -> float:
    """How long rnx2rtkp takes for GPS single-point positions, as a whole command [s]."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["rnx2rtkp", "-p", "0", "-sys", "G", "-o", f"{folder}/out.pos", str(log.rover)]
        return seconds(
            lambda: subprocess.run(
                [*command, *map(str, log.navigation)], check=True, capture_output=True, timeout=PEER_LIMIT_S
            )
        )


def informed(log: Log, config: Config) -> Correction:
    """A pipeline that knows what the log's satellites broadcast."""
    correction = Correction(config)
    navigation = read_navigation(log.navigation)
    for ephemeris in navigation.ephemerides:
        correction.add(ephemeris)
    if navigation.ionosphere is not None:
        correction.add(navigation.ionosphere)
    return correction


def solve(log: Log, method: Method = "original") -> int:
    """Read the log and solve it for GPS positions; gives the number of epochs."""
    correction = informed(log, Config(method=method, compare=(), systems="G"))
    observations = read_observations(log.rover)
    correction.block(observations)
    return len(observations)


def live_p99_ms(log: Log) -> float:
    """99th percentile over the log's epochs: message in, fix and verdicts encoded, by the service's defaults [ms]."""
    observations = read_observations(log.rover)
    epochs = [observations.epoch(index) for index in range(len(observations))]
    correction = informed(log, Config())
    took_s = []
    for epoch in epochs:
        started = time.perf_counter()
        corrected = correction.epoch(epoch)
        for method in correction.methods:
            encode(fixes_of(corrected, method)[0])
        encode(verdicts_of(corrected)[0])
        took_s.append(time.perf_counter() - started)
    return 1e3 * sorted(took_s)[int(0.99 * len(took_s))]


def command_s(log: Log) -> float:
    """How long `kirotei gnss solve` takes as a whole command, imports included [s]."""
    with tempfile.TemporaryDirectory() as folder:
        command = [str(Path(sys.executable).with_name("kirotei")), "gnss", "solve", "--rover", str(log.rover)]
        command += [word for path in log.navigation for word in ("--nav", str(path))]
        command += ["--method", "original", "--systems", "G", "--out", f"{folder}/fixes.csv"]
        return seconds(lambda: subprocess.run(command, check=True, capture_output=True, timeout=PEER_LIMIT_S))


def measure(log: Log, rounds: int) -> list[Result]:
    """Every comparison on one log."""
    size_mb = log.rover.stat().st_size / 1e6
    peer = (lambda: georinex_s(log)) if PEER_PYTHON.exists() else None
    own_s, peer_s = alternate(rounds, lambda: seconds(lambda: read_observations(log.rover)), peer)
    too_slow = peer_s is not None and peer_s != peer_s  # noqa: PLR0124 - NaN
    results = [
        Result(
            "read RINEX observations",
            log.name,
            "MB/s",
            size_mb / own_s,
            "georinex",
            None if peer_s is None or too_slow else size_mb / peer_s,
            None if peer_s is None or too_slow else peer_s / own_s,
            f"georinex took more than {PEER_LIMIT_S:g} s" if too_slow else "" if peer else "georinex: run `make bench`",
        )
    ]
    epochs = solve(log)
    rtklib = (lambda: rnx2rtkp_s(log)) if shutil.which("rnx2rtkp") else None
    sides: Sequence[tuple[str, Callable[[], float]]] = (
        ("single point, parsing included", lambda: seconds(lambda: solve(log))),
        ("robust filter, parsing included", lambda: seconds(lambda: solve(log, "robust"))),
        ("single point, as a whole command", lambda: command_s(log)),
    )
    for case, ours in sides:
        own_s, peer_s = alternate(rounds, ours, rtklib)
        results.append(
            Result(
                case,
                log.name,
                "epochs/s",
                epochs / own_s,
                "rnx2rtkp",
                None if peer_s is None else epochs / peer_s,
                None if peer_s is None else peer_s / own_s,
                "" if rtklib else "rnx2rtkp: install rtklib",
            )
        )
    live_p99_ms(log)
    live_ms = statistics.median(live_p99_ms(log) for _ in range(rounds))
    results.append(Result("live epoch to fix, p99", log.name, "ms", live_ms, "", None, None, "all default methods"))
    return results


def run(*, json: bool = False, rounds: int = ROUNDS) -> list[Result]:
    """Measure, print the table (or JSON) and give the results."""
    about = machine()
    with tempfile.TemporaryDirectory() as folder:
        results = [result for log in logs(Path(folder)) for result in measure(log, rounds)]
        results += measure_streams(Path(folder), rounds)
    if json:
        found = {"machine": about, "results": [asdict(result) for result in results]}
        sys.stdout.write(json_text.dumps(found, indent=2) + "\n")
    else:
        sys.stdout.write(f"{about}\nmedians of {rounds} rounds\n{table(results)}\n")
    return results
