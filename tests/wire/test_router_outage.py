"""No router yet, no router for a while, a router that cannot be."""

from __future__ import annotations

import asyncio
import sys
import threading
from pathlib import Path

import pytest

from services.runtime.clock import LiveClock
from services.runtime.host_config import BusConfig, RouterConfig
from services.runtime.router import RouterError, open_router
from services.runtime.zenoh_config import BusConfigError
from services.runtime.zenoh_liveliness import services_alive
from services.runtime.zenoh_node import ZenohNode
from services.runtime.zenoh_publishers import NodeClosedError
from tests.wire.stage import (
    KEPT,
    STATE,
    STREAM,
    TRAIN,
    Stage,
    event,
    fix,
    next_sample,
    service,
    stream_until_heard,
    take,
    truth,
    until,
    within,
)


async def test_a_node_waits_for_its_router(stage: Stage, endpoint: str) -> None:
    reasons: list[str] = []
    opening = asyncio.create_task(stage.node("writer", writes=(KEPT,), on_waiting=reasons.append))
    await until(lambda: bool(reasons))
    assert endpoint in reasons[0]
    with open_router(RouterConfig(listen=(endpoint,))):
        writer = await opening
        await writer.publish(KEPT, event(0), service="writer")


async def test_waiting_for_a_router_can_be_cancelled(stage: Stage) -> None:
    tried = asyncio.Event()
    opening = asyncio.create_task(stage.node("writer", on_waiting=lambda _: tried.set()))
    await within(tried.wait())
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening


async def mortal_router(endpoint: str) -> asyncio.subprocess.Process:
    """A router in a process of its own, to be killed."""
    program = (
        "import sys; from services.runtime.host_config import RouterConfig; "
        "from services.runtime.router import open_router; "
        "router = open_router(RouterConfig(listen=(sys.argv[1],))); print('ready', flush=True); sys.stdin.read()"
    )
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", program, endpoint, stdin=pipe, stdout=pipe, stderr=asyncio.subprocess.DEVNULL
    )
    assert process.stdout is not None
    assert await within(process.stdout.readline()) == b"ready\n"
    return process


async def test_everything_lives_again_after_a_router_restart(stage: Stage, endpoint: str) -> None:
    first = await mortal_router(endpoint)
    writer = await stage.node("writer", writes=(STREAM, STATE, KEPT))
    reader = await stage.node("reader", reads=(STREAM, STATE, KEPT))
    stream, state, events = reader.arrivals(STREAM), reader.arrivals(STATE), reader.arrivals(KEPT)
    alive: set[tuple[str, bool]] = set()
    watching = asyncio.create_task(collect_alive(reader, alive))
    await writer.publish(STATE, fix(0), device="front")
    await writer.publish(KEPT, event(0), service="writer")
    heard = await stream_until_heard(writer, stream)
    assert [a.message.t_ns for a in await take(state, 1) + await take(events, 1)] == [0, 0]

    first.kill()
    await first.wait()
    for number in range(1, 101):
        await writer.publish(STATE, fix(number), device="front")
        await writer.publish(KEPT, event(number), service="writer")
        await writer.publish(STREAM, truth(number), device="front")
    with open_router(RouterConfig(listen=(endpoint,))):
        # EVENT: all of it, once, in order. STATE: the newest. STREAM: what was sent meanwhile is gone, and counted.
        assert [a.message.t_ns for a in await take(events, 100)] == list(range(1, 101))
        assert (await take(state, 1))[0].message.t_ns == 100
        again = await stream_until_heard(writer, stream, start=101)
        inputs = {entry.key: entry for entry in reader.health.report(0, 0.0).inputs}
        # What the transport had taken before the cut may still have come, but never all hundred of it.
        assert inputs[STREAM.at(TRAIN, device="front")].missing > 0
        assert again.sequence > heard.sequence + 1
        assert inputs[KEPT.at(TRAIN, service="writer")].missing == 0
        assert "missing on" in " ".join(reader.health.level(reader.clock.monotonic_s())[1])
        assert [text for kind, text in reader.health.take_notices() if kind == "input_gap"]
        names = {token.instance for token in await within(services_alive(stage.bus))}
        assert names == {"reader", "writer"}
        # Tokens came back within their time: nobody was ever called lost.
        assert alive == {("reader", True), ("writer", True)}
        await writer.publish(KEPT, event(101), service="writer")
        assert [a.message.t_ns for a in await take(events, 1)] == [101]
        reader.stop()
        await watching


async def collect_alive(node: ZenohNode, seen: set[tuple[str, bool]]) -> None:
    async for change in node.watch_alive():
        seen.add((change.token.instance, change.alive))


async def test_an_outage_longer_than_the_cache_is_a_counted_loss(stage: Stage, endpoint: str) -> None:
    first = open_router(RouterConfig(listen=(endpoint,)))
    writer = await stage.node("writer", writes=(KEPT,))
    reader = await stage.node("reader", reads=(KEPT,))
    events = reader.arrivals(KEPT)
    await writer.publish(KEPT, event(0), service="writer")
    await take(events, 1)
    first.close()
    for number in range(1, 1501):
        await writer.publish(KEPT, event(number), service="writer")
    with open_router(RouterConfig(listen=(endpoint,))):
        heard = [a.message.t_ns for a in await take(events, 1000)]
    assert heard == list(range(501, 1501))
    assert reader.health.report(0, 0.0).inputs[0].missing == 500
    await until(lambda: reader.health.counts.get("lost") == 500)


async def test_a_restarted_sender_is_seen_as_one(stage: Stage, endpoint: str) -> None:
    with open_router(RouterConfig(listen=(endpoint,))):
        reader = await stage.node("reader", reads=(KEPT,))
        events = reader.arrivals(KEPT)
        for start in range(2):
            writer = await stage.node("writer", writes=(KEPT,))
            await writer.publish(KEPT, event(start), service="writer")
            arrival = (await take(events, 1))[0]
            assert (arrival.boot_id, arrival.sequence, arrival.message.t_ns) == (writer.boot_id, 0, start)
            await writer.close()
    report = reader.health.report(0, 0.0)
    assert [(entry.restarts, entry.missing) for entry in report.inputs] == [(1, 0)]
    assert [kind for kind, _ in reader.health.take_notices()] == ["input_restart"]


def test_a_taken_address_is_named(endpoint: str) -> None:
    config = RouterConfig(listen=(endpoint,))
    with open_router(config), pytest.raises(RouterError, match="in use") as caught:
        open_router(config)
    assert endpoint in str(caught.value)


async def test_a_wrong_zenoh_file_is_named_at_once(tmp_path: Path) -> None:
    broken = tmp_path / "zenoh.json5"
    broken.write_text("{ mode: ")
    for bus in (BusConfig(config_file=str(broken)), BusConfig(config_file=str(tmp_path / "absent.json5"))):
        with pytest.raises(BusConfigError, match=r"is no Zenoh configuration"):
            await within(ZenohNode.open(service("writer"), TRAIN, "writer", LiveClock(), bus))
    with pytest.raises(BusConfigError, match=r"broken|zenoh\.json5"):
        open_router(RouterConfig(config_file=str(broken)))


async def test_a_zenoh_file_is_what_a_session_starts_from(tmp_path: Path, stage: Stage, endpoint: str) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text('{ mode: "peer", namespace: "isolated" }')
    with open_router(RouterConfig(listen=(endpoint,))):
        stage.bus = BusConfig(connect=(endpoint,), config_file=str(file))
        subscriber = stage.foreigner().declare_subscriber("isolated/**")
        writer = await stage.node("writer", writes=(KEPT,))
        await writer.publish(KEPT, event(0), service="writer")
        sample = await next_sample(subscriber)
        assert str(sample.key_expr) == f"isolated/{KEPT.at(TRAIN, service='writer')}"


def test_closing_leaves_no_thread(endpoint: str) -> None:
    before = threading.active_count()

    async def live() -> None:
        node = await within(
            ZenohNode.open(
                service("both", (KEPT,), (KEPT, STREAM)), TRAIN, "both", LiveClock(), BusConfig(connect=(endpoint,))
            )
        )
        events = node.arrivals(KEPT)
        await node.publish(KEPT, event(0), service="both")
        await node.publish(STREAM, truth(0), device="front")
        await take(events, 1)
        await node.close()
        await node.close()
        for topic, message, fields in ((KEPT, event(1), {"service": "both"}), (STREAM, truth(1), {"device": "front"})):
            with pytest.raises(NodeClosedError):
                await node.publish(topic, message, **fields)

    with open_router(RouterConfig(listen=(endpoint,))):
        for _ in range(3):
            asyncio.run(live())
    assert threading.active_count() == before
