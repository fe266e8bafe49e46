"""Recording from and replaying onto a real Zenoh network."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from schemas import topics
from schemas.health import ServiceEvent
from schemas.topic import Place
from services.recorder.contents_file import contents_of
from services.recorder.mcap_file import RecordingWriter
from services.recorder.part_file import PartFile
from services.recorder.recording_file import read_recording, require_complete
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.node import Sample
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode
from tests.unit.recorder.samples import TRAIN, truth_sample
from tests.wire.ports import free_port

LIMIT_S = 30.0


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Address of a router."""
    address = f"tcp/127.0.0.1:{free_port()}"
    with open_router(RouterConfig(listen=(address,))):
        yield address


@asynccontextmanager
async def joined(name: str, endpoint: str, place: Place = TRAIN) -> AsyncIterator[ZenohNode]:
    service = guest(name, "a test's service", reads=topics.ALL, writes=topics.ALL)
    node = await ZenohNode.open(service, place, name, LiveClock(), BusConfig(connect=(endpoint,)))
    try:
        yield node
    finally:
        await node.close()


async def command(*words: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        sys.executable, "-m", "services.cli", *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )


async def outcome(process: asyncio.subprocess.Process) -> tuple[int | None, str, str]:
    async with asyncio.timeout(LIMIT_S):
        out, error = await process.communicate()
    return process.returncode, out.decode(), error.decode()


def event(index: int) -> ServiceEvent:
    return ServiceEvent(t_ns=index, service="speaker", boot_id="b", kind="level", text=f"number {index}")


def recorded(path: Path, samples: list[Sample]) -> Path:
    part = PartFile(path)
    writer = RecordingWriter(part)
    for sample in samples:
        writer.write(sample)
    writer.finish()
    part.complete()
    return path


async def test_record_until_ctrl_c_and_nothing_of_an_event_topic_is_missing(endpoint: str, tmp_path: Path) -> None:
    out, part = tmp_path / "run.mcap", tmp_path / "run.mcap.part"
    async with joined("speaker", endpoint) as node:
        for index in range(100):
            await node.publish(topics.SERVICE_EVENT, event(index), service="speaker")
        process = await command("record", str(out), "--connect", endpoint, "--json")
        # Late readers get what an event topic keeps, so all hundred come although it starts after them.
        async with asyncio.timeout(LIMIT_S):
            while not (part.exists() and part.stat().st_size > 2000):  # noqa: ASYNC110 - another process writes it
                await asyncio.sleep(0.05)
        process.send_signal(signal.SIGINT)
        code, told, error = await outcome(process)
    assert (code, error) == (0, "")
    assert json.loads(told)["messages"] == 100
    samples = list(read_recording(out))
    assert [sample.key for sample in samples] == [topics.SERVICE_EVENT.at(TRAIN, service="speaker")] * 100
    assert len({sample.attachment for sample in samples}) == 100


PROFILE = """
[place]
line = "demo"
kind = "train"
name = "T1"
[bus]
connect = ["{endpoint}"]
[recorder]
folder = "{folder}"
flush_s = 0.1
"""


def file_with(folder: Path, count: int) -> Path | None:
    """File in the folder that holds so many messages."""
    return next((path for path in folder.glob("*.mcap*") if contents_of(path).messages >= count), None)


async def recorded_at_least(folder: Path, count: int) -> Path:
    """File in the folder once it holds so many messages."""
    async with asyncio.timeout(LIMIT_S):
        while (path := file_with(folder, count)) is None:  # noqa: ASYNC110 - another process writes it
            await asyncio.sleep(0.05)
    return path


async def test_a_recorder_that_is_killed_loses_nothing_that_was_flushed(endpoint: str, tmp_path: Path) -> None:
    folder, profile = tmp_path / "recordings", tmp_path / "host.toml"
    profile.write_text(PROFILE.format(endpoint=endpoint, folder=folder))
    async with joined("speaker", endpoint) as node:
        first = await command("run", "recorder", "--config", str(profile))
        for index in range(100):
            await node.publish(topics.SERVICE_EVENT, event(index), service="speaker")
        part = await recorded_at_least(folder, 100)
        first.kill()
        await outcome(first)
        before = contents_of(part).messages
        second = await command("run", "recorder", "--config", str(profile))
        repaired = folder / part.name.removesuffix(".part")
        async with asyncio.timeout(LIMIT_S):
            while not repaired.exists():  # noqa: ASYNC110 - another process writes it
                await asyncio.sleep(0.05)
        second.terminate()
        code, _, error = await outcome(second)
    assert (code, error) == (0, "")
    assert len(list(read_recording(repaired))) == before >= 100
    assert not list(folder.glob("*.part"))
    for path in folder.iterdir():
        require_complete(path)


async def test_replay_speaks_with_the_original_keys_and_bytes_and_its_own_mark(endpoint: str, tmp_path: Path) -> None:
    samples = [truth_sample(index) for index in range(20)]
    path = recorded(tmp_path / "run.mcap", samples)
    async with joined("listener", endpoint) as node:
        arrivals = node.arrivals(topics.TRAIN_TRUTH)
        process = await command("replay", str(path), "--live", "--speed", "10", "--connect", endpoint, "--json")
        async with asyncio.timeout(LIMIT_S):
            heard = [await anext(arrivals) for _ in range(20)]
        code, told, error = await outcome(process)
    assert (code, error) == (0, "")
    assert json.loads(told)["source"] == "demo/train/T1/replay"
    assert [arrival.message.axis_m for arrival in heard] == [3.0 * index for index in range(20)]
    assert {arrival.source for arrival in heard} == {"demo/train/T1/replay"}
    assert [arrival.sequence for arrival in heard] == list(range(20))


async def test_replay_beside_the_living_original_is_refused_and_another_line_is_not(
    endpoint: str, tmp_path: Path
) -> None:
    path = recorded(tmp_path / "run.mcap", [truth_sample(0)])
    other = Place("rehearsal", "train", "T1")
    async with joined("simulator", endpoint), joined("listener", endpoint, other) as node:
        refused = await outcome(await command("replay", str(path), "--live", "--connect", endpoint))
        arrivals = node.arrivals(topics.TRAIN_TRUTH)
        process = await command("replay", str(path), "--live", "--line", "rehearsal", "--connect", endpoint)
        async with asyncio.timeout(LIMIT_S):
            heard = await anext(arrivals)
        done = await outcome(process)
    assert refused[0] == 1
    assert "demo/train/T1/simulator live on this bus and would be mixed" in refused[2]
    assert "--line NAME" in refused[2]
    assert heard.source == "rehearsal/train/T1/replay"
    assert done[0] == 0


async def test_replay_ends_when_the_original_appears(endpoint: str, tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", [truth_sample(index) for index in range(0, 3000, 5)])
    async with joined("listener", endpoint) as node:
        arrivals = node.arrivals(topics.TRAIN_TRUTH)
        process = await command("replay", str(path), "--live", "--connect", endpoint)
        async with asyncio.timeout(LIMIT_S):
            await anext(arrivals)
        async with joined("simulator", endpoint):
            code, _, error = await outcome(process)
    assert code == 1
    assert "demo/train/T1/simulator live on this bus" in error
