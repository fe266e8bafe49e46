"""The radio's watch as a process, killed -9 in the middle of a pass: it goes on as if it had not been."""

from __future__ import annotations

import asyncio
import signal
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from schemas.codec import decode
from schemas.radio import RadioEvent
from schemas.topics import RADIO_EVENT, RADIO_MEASUREMENT, topic_of
from services.radio_anomaly.file_analysis import learn
from services.radio_anomaly.radio_model_file import write_model
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.service import SERVICE, Config
from services.radio_anomaly.settings import Settings
from services.recorder.offline_replay import replay_through
from services.runtime.clock import LiveClock
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.node import Node, Service
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode
from tests.replay.test_radio_anomaly import message_of, sample
from tests.unit.radio_anomaly.made_up import one_pass
from tests.wire.ports import free_port
from tests.wire.processes import PATIENCE_S, running, write_profile
from tests.wire.stage import TRAIN, NoConfig

LIMIT_S = 2.0 * PATIENCE_S
LEARNED = 24
STRETCH = (15, 25)


async def _idle(node: Node, config: NoConfig) -> None:
    del node, config


PROBE = Service("radio_probe", NoConfig, (RADIO_EVENT,), (RADIO_MEASUREMENT,), _idle, "a test's probe, and who is told")


async def until(met: Callable[[], bool]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while not met():  # noqa: ASYNC110 - another process brings it
            await asyncio.sleep(0.05)


def kept(folder: Path) -> list[Path]:
    return list(folder.rglob("*.json"))


def uninterrupted(readings: Sequence[Reading], config: Config) -> list[RadioEvent]:
    """What a watch tells that nobody kills."""
    tape = [sample(RADIO_MEASUREMENT, message_of(r), n, TRAIN, device="cab") for n, r in enumerate(readings)]
    said = replay_through(tape, [SERVICE], {"radio_anomaly": config})
    events = [one for one in said if (at := topic_of(one.key)) is not None and at.topic is RADIO_EVENT]
    return [decode(RadioEvent, one.payload) for one in events]


async def test_a_watch_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    port = free_port()
    model, folder = tmp_path / "model.json", tmp_path / "kept"
    history = [one for n in range(LEARNED) for one in one_pass(n)]
    write_model(model, learn(history, Settings(), "line", "made up", Counter()))
    more = f'[radio_anomaly]\nmodel_file = "{model}"\nstate_folder = "{folder}"\nsave_s = 1.0\n'
    profile = write_profile(tmp_path, port, more=more)
    told: list[RadioEvent] = []
    command = ("-m", "services.cli", "run", "radio_anomaly", "--config", str(profile))
    passes = [one_pass(n, change_db=-12.0, stretch=STRETCH) for n in range(LEARNED, LEARNED + 4)]
    half = len(passes[1]) // 2
    with open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))):
        bus = BusConfig(connect=(f"tcp/127.0.0.1:{port}",))
        node = await ZenohNode.open(PROBE, TRAIN, PROBE.name, LiveClock(), bus)

        async def say(*readings: Reading) -> None:
            for one in readings:
                await node.publish(RADIO_MEASUREMENT, message_of(one), device="cab")

        async def hear() -> None:
            async for message in node.messages(RADIO_EVENT):
                told.append(message)  # noqa: PERF401 - it is read meanwhile

        hearing = asyncio.create_task(hear())
        try:
            with running(*command) as watch:
                await say(*passes[0], *passes[1][:half])
                await until(lambda: bool(kept(folder)))
                watch.send(signal.SIGKILL)
                watch.ended()
            await say(*passes[1][half:])
            with running(*command) as watch:
                await say(*passes[2], *passes[3])
                await until(lambda: any(one.pass_id == passes[3][0].pass_id for one in told))
                watch.send(signal.SIGTERM)
                assert watch.ended() == 0
        finally:
            hearing.cancel()
            await node.close()
    readings = [one for each in passes for one in each]
    whole = Config(model_file=str(model))
    wanted = await asyncio.to_thread(uninterrupted, readings, whole)  # which has a loop of its own
    assert {(one.event_id, one.pass_id) for one in told} == {(one.event_id, one.pass_id) for one in wanted}
    assert {one.event_id for one in told if one.confirmed} == {one.event_id for one in wanted if one.confirmed}
    # What the bus says again after the kill may be told again, under the same event; it begins once.
    assert Counter(one.event_id for one in told if one.phase == "began") == Counter({wanted[0].event_id: 1})
