"""Health once a second and at every change; events, not too many of them."""

from __future__ import annotations

import asyncio
import itertools

from hypothesis import given
from hypothesis import strategies as st

from schemas.codec import encode
from schemas.health import Health, ServiceEvent
from schemas.position import TrainTruth
from schemas.topic import Place
from schemas.topics import HEALTH, SERVICE_EVENT, TRAIN_TRUTH
from services.runtime.attachment import Attachment, encode_attachment
from services.runtime.clock import ManualClock
from services.runtime.guest import guest
from services.runtime.manual_loop import run_manual
from services.runtime.memory_node import MemoryBus, MemoryNode
from services.runtime.node import Node, Sample
from services.runtime.service_report import EVENT_BURST, EVENT_RATE_HZ, EventLimiter, ServiceReport
from tests.unit.schemas.examples import EXAMPLES

TRAIN = Place("demo", "train", "T1")
KEY = TRAIN_TRUTH.at(TRAIN, device="front")
TRUTH = EXAMPLES[TrainTruth]


async def _read(node: Node) -> None:
    async for _ in node.messages(TRAIN_TRUTH):
        pass


async def _report_for(seconds: float, script: dict[float, str]) -> tuple[list[Health], list[ServiceEvent]]:
    """What a viewer hears while a service's board changes as the script says, by time."""
    clock = ManualClock(asyncio.get_running_loop())
    bus = MemoryBus()
    about = "reported on"
    subject = MemoryNode(bus, guest("subject", about, reads=(TRAIN_TRUTH,)), TRAIN, clock)
    viewer = MemoryNode(bus, guest("viewer", "reads", reads=(HEALTH, SERVICE_EVENT)), TRAIN, clock)
    messages = viewer.messages(HEALTH, SERVICE_EVENT)
    noted: list[str] = []
    report = ServiceReport(subject, note=lambda _, text: noted.append(text), started=True)
    task = asyncio.create_task(report.run())
    reading = asyncio.create_task(_read(subject))
    for at_s, what in script.items():
        await asyncio.sleep(at_s - clock.monotonic_s())
        if what == "gap":
            for sequence in range(0, 200, 2):
                attachment = encode_attachment(Attachment("s", "b", sequence, 0))
                bus.put(Sample(KEY, encode(TRUTH), attachment, 0), TRAIN_TRUTH.delivery)
        elif what == "well":
            subject.health.clear("why")
        else:
            subject.health.set("why", what)
    await asyncio.sleep(seconds - clock.monotonic_s())
    task.cancel()
    reading.cancel()
    viewer.stop()
    heard = [message async for message in messages]
    assert noted == [message.text for message in heard if isinstance(message, ServiceEvent)]
    return [m for m in heard if isinstance(m, Health)], [m for m in heard if isinstance(m, ServiceEvent)]


def test_a_well_service_reports_once_a_second() -> None:
    health, events = run_manual(_report_for(10.05, {}))
    assert len(health) == 11
    assert {report.level for report in health} == {"ok"}
    assert events == []


def test_a_change_of_level_is_told_at_once_with_its_reason() -> None:
    health, events = run_manual(_report_for(4.05, {1.55: "no sky", 2.55: "well"}))
    changes = [report for before, report in itertools.pairwise(health) if before.level != report.level]
    assert [(round(report.t_ns / 1e9, 1), report.level) for report in changes] == [(1.6, "degraded"), (2.6, "ok")]
    assert [(event.kind, event.text) for event in events] == [
        ("level", "ok -> degraded: no sky"),
        ("level", "degraded -> ok: all is well"),
    ]


def test_gaps_become_events_up_to_a_limit_and_the_rest_is_counted() -> None:
    _, events = run_manual(_report_for(3.05, {0.05: "gap"}))
    gaps = [event for event in events if event.kind == "input_gap"]
    assert len(gaps) == EVENT_BURST
    assert gaps[0].text.startswith(f"1 missing on {KEY} from s")
    # The gaps colour the level for ten seconds: its fall is among what is left out, its return is told.
    _, events = run_manual(_report_for(12.05, {0.05: "gap"}))
    assert [event.text for event in events if "left out" in event.text] == [
        f"degraded -> ok: all is well ({99 + 1 - EVENT_BURST} events before this one left out)"
    ]


@given(st.lists(st.floats(0.0, 3.0), max_size=200))
def test_the_limiter_keeps_its_rate_and_loses_no_count(waits_s: list[float]) -> None:
    limiter, now_s, admitted, told = EventLimiter(), 0.0, 0, 0
    for wait_s in waits_s:
        now_s += wait_s
        suppressed = limiter.admit(now_s)
        if suppressed is not None:
            admitted += 1
            told += suppressed
    assert admitted <= EVENT_BURST + now_s * EVENT_RATE_HZ
    assert admitted + told + limiter.suppressed == len(waits_s)
