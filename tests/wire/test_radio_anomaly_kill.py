"""The radio's watch as a process, killed -9 in the middle of a pass: it goes on as if it had not been."""

from __future__ import annotations

import asyncio
import signal
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from schemas.codec import decode
from schemas.radio import RadioEvent, RadioSection
from schemas.topics import RADIO_EVENT, RADIO_MEASUREMENT, RADIO_SECTION, topic_of
from services.radio_anomaly.file_analysis import learn
from services.radio_anomaly.radio_model import RadioModel
from services.radio_anomaly.radio_model_file import read_model, write_model
from services.radio_anomaly.reading import Reading
from services.radio_anomaly.service import SERVICE, Config
from services.radio_anomaly.settings import Settings
from services.recorder.offline_replay import replay_through
from services.runtime.clock import LiveClock
from services.runtime.guest import guest
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.router import open_router
from services.runtime.zenoh_node import ZenohNode
from tests.replay.test_radio_anomaly import message_of, sample
from tests.unit.radio_anomaly.made_up import one_pass
from tests.wire.ports import free_port
from tests.wire.processes import PATIENCE_S, running, write_profile
from tests.wire.stage import TRAIN

LIMIT_S = 2.0 * PATIENCE_S
LEARNED = 24
STRETCH = (15, 25)
BEGUN = 10
"""Readings of the last pass: with the last of them its fourth section begins, and it is looked at."""
PROBE = guest("radio_probe", "a test's probe", reads=(RADIO_EVENT, RADIO_SECTION), writes=(RADIO_MEASUREMENT,))


async def until(met: Callable[[], bool]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while not met():  # noqa: ASYNC110 - another process brings it
            await asyncio.sleep(0.05)


def kept(folder: Path) -> RadioModel | None:
    found = list(folder.rglob("*.json"))
    return read_model(found[0]) if found else None


def what_it_knows(folder: Path) -> RadioModel:
    """All of a model kept but who its senders were."""
    model = kept(folder)
    assert model is not None
    return msgspec.structs.replace(model, heard_until=())


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
    shown: list[RadioSection] = []
    command = ("-m", "services.cli", "run", "radio_anomaly", "--config", str(profile))
    passes = [one_pass(n, change_db=-12.0, stretch=STRETCH) for n in range(LEARNED, LEARNED + 4)]
    passes.append(one_pass(LEARNED + 4)[:BEGUN])
    half = len(passes[1]) // 2
    readings = [one for each in passes for one in each]
    whole = Config(model_file=str(model), state_folder=str(tmp_path / "whole"))
    wanted = await asyncio.to_thread(uninterrupted, readings, whole)  # which has a loop of its own
    with open_router(RouterConfig(listen=(f"tcp/127.0.0.1:{port}",))):
        bus = BusConfig(connect=(f"tcp/127.0.0.1:{port}",))
        node = await ZenohNode.open(PROBE, TRAIN, PROBE.name, LiveClock(), bus)

        async def say(*readings: Reading) -> None:
            for one in readings:
                await node.publish(RADIO_MEASUREMENT, message_of(one), device="cab")

        async def hear() -> None:
            async for message in node.messages(RADIO_EVENT, RADIO_SECTION):
                match message:
                    case RadioEvent():
                        told.append(message)
                    case RadioSection():
                        shown.append(message)

        def half_is_kept() -> bool:
            """What was told on the pass under way is on disk: nothing of it is to be told again."""
            model = kept(folder)
            return model is not None and any(one.name == passes[1][0].pass_id for one in model.telling)

        hearing = asyncio.create_task(hear())
        try:
            with running(*command) as watch:
                await say(*passes[0], *passes[1][:half])
                await until(half_is_kept)
                watch.send(signal.SIGKILL)
                watch.ended()
            await say(*passes[1][half:])
            with running(*command) as watch:
                await say(*passes[2], *passes[3], *passes[4])
                await until(lambda: any(one.pass_id == passes[4][0].pass_id for one in shown))
                watch.send(signal.SIGTERM)
                assert watch.ended() == 0
            await until(lambda: len(told) >= len(wanted))
        finally:
            hearing.cancel()
            await node.close()
    # The bus says everything again after the kill, of which one pass was learned and half a pass was told of.
    assert told == wanted
    assert Counter(one.phase for one in told)["began"] == 1
    assert what_it_knows(folder) == what_it_knows(tmp_path / "whole")
