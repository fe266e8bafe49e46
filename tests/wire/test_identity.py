"""One place, one name, one service: tokens, twins, and who is alive."""

from __future__ import annotations

import asyncio

import pytest

from schemas.topic import Place
from services.runtime.alive import AliveChange, Token
from services.runtime.clock import LiveClock
from services.runtime.zenoh_liveliness import IdentityTakenError, services_alive
from services.runtime.zenoh_node import ZenohNode
from tests.wire.stage import KEPT, TRAIN, Stage, event, service, take, within

pytestmark = pytest.mark.usefixtures("router")


class HastyClock(LiveClock):
    """Twenty seconds pass in one: what waits for a predecessor gives up sooner."""

    def monotonic_s(self) -> float:
        return 20.0 * super().monotonic_s()


async def test_a_second_service_of_the_same_identity_is_turned_away(stage: Stage) -> None:
    first = await stage.node("gnss_receiver", writes=(KEPT,))
    with pytest.raises(IdentityTakenError) as caught:
        await stage.node("gnss_receiver", clock=HastyClock())
    assert "gnss_receiver" in str(caught.value)
    assert "demo/train/T1" in str(caught.value)
    assert first.boot_id in str(caught.value)
    assert "gnss_receiver@name" in str(caught.value)
    # The first one never noticed.
    reader = await stage.node("reader", reads=(KEPT,))
    await first.publish(KEPT, event(0), service="gnss_receiver")
    assert len(await take(reader.arrivals(KEPT), 1)) == 1


async def test_another_place_or_instance_is_somebody_else(stage: Stage) -> None:
    await stage.node("gnss_receiver")
    await stage.node("gnss_receiver@rear")
    await stage.node("gnss_receiver", place=Place("demo", "train", "T2"))
    names = [token.service for token in await within(services_alive(stage.bus))]
    assert names == ["demo/train/T1/gnss_receiver", "demo/train/T1/gnss_receiver@rear", "demo/train/T2/gnss_receiver"]
    assert await within(services_alive(stage.bus, "elsewhere")) == []


async def test_a_crashed_predecessor_is_waited_for(stage: Stage) -> None:
    first = await stage.node("recorder")
    opening = asyncio.create_task(stage.node("recorder"))
    asyncio.get_running_loop().call_later(0.5, lambda: asyncio.ensure_future(first.close()))
    second = await opening
    assert second.boot_id != first.boot_id


async def test_of_two_that_start_at_once_one_stays(stage: Stage) -> None:
    outcomes = await asyncio.gather(
        *(stage.node("recorder", clock=HastyClock()) for _ in range(2)), return_exceptions=True
    )
    assert sorted(type(outcome).__name__ for outcome in outcomes) == ["IdentityTakenError", "ZenohNode"]
    assert len(await within(services_alive(stage.bus))) == 1


async def test_onlookers_have_no_identity(stage: Stage) -> None:
    nodes = [
        await within(ZenohNode.open(service("watch"), TRAIN, "watch", LiveClock(), stage.bus, announced=False))
        for _ in range(2)
    ]
    assert await within(services_alive(stage.bus)) == []
    for node in nodes:
        await node.close()


async def test_a_service_is_lost_five_seconds_after_its_token(stage: Stage) -> None:
    watcher = await stage.node("watcher")
    changes = watcher.watch_alive()
    first = await stage.node("recorder")
    seen = [change.token.instance for change in await take(changes, 2)]
    assert sorted(seen) == ["recorder", "watcher"]
    await first.close()
    loop = asyncio.get_running_loop()
    closed_s = loop.time()
    assert await take(changes, 1) == [AliveChange(Token(TRAIN, "recorder", first.boot_id), alive=False)]
    assert loop.time() - closed_s >= 4.9  # five seconds, less what passed before the token was seen to vanish
    # A restart within the time is a new start of a service that was never lost.
    second = await stage.node("recorder")
    assert await take(changes, 1) == [AliveChange(Token(TRAIN, "recorder", second.boot_id), alive=True)]
    await second.close()
    third = await stage.node("recorder")
    assert await take(changes, 1) == [AliveChange(Token(TRAIN, "recorder", third.boot_id), alive=True)]
    watcher.stop()
    with pytest.raises(StopAsyncIteration):
        await take(changes, 1)
