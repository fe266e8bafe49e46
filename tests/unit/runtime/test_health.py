"""A service's verdict on itself."""

from __future__ import annotations

import pytest

from services.runtime.attachment import Attachment
from services.runtime.health import MAX_NOTICES, MAX_SHOWN, TROUBLE_SHOWN_S, HealthBoard, InputWatch

KEY = "kirotei/v1/demo/train/T1/gnss/front/fix"


def board() -> HealthBoard:
    return HealthBoard("gnss_correction", "boot", 100.0)


def arrive(watch: InputWatch, sequence: int, boot_id: str = "a", now_s: float = 100.0, key: str = KEY) -> bool:
    """Take one arrival as a reader does; False for a repetition."""
    entry = watch.follow(key, "source")
    assert entry is not None
    entry.newest_s, entry.delay_ns = now_s, 2_000_000
    missing = entry.tracker.missing
    mark = entry.tracker.take(boot_id, sequence)
    sent = Attachment("source", boot_id, sequence, 0)
    return watch.judge(mark, key, sent, entry.tracker.missing - missing, now_s)


def test_a_service_is_well_until_it_says_otherwise() -> None:
    health = board()
    assert health.level(100.0) == ("ok", ())
    health.set("disk", "disk full")
    assert health.level(100.0) == ("degraded", ("disk full",))
    health.set("receiver", "no receiver", "failed")
    assert health.level(100.0) == ("failed", ("disk full", "no receiver"))
    health.clear("receiver")
    health.clear("disk")
    health.clear("never set")
    assert health.level(100.0) == ("ok", ())


def test_trouble_passes() -> None:
    health = board()
    health.trouble("gap", "3 missing", 100.0)
    assert health.level(100.0 + TROUBLE_SHOWN_S)[0] == "degraded"
    assert health.level(100.1 + TROUBLE_SHOWN_S) == ("ok", ())


def test_gaps_restarts_and_twins_become_trouble_and_notices() -> None:
    health = board()
    watch = health.open_reader()
    for sequence, boot_id in ((0, "a"), (3, "a"), (0, "b"), (4, "a")):
        assert arrive(watch, sequence, boot_id)
    assert not arrive(watch, 4)
    assert [kind for kind, _ in health.take_notices()] == ["input_gap", "input_restart"]
    assert health.take_notices() == []
    reasons = " / ".join(health.level(100.0)[1])
    assert "2 missing on" in reasons
    assert "source restarted (now b)" in reasons
    assert "two senders share the identity source" in reasons


def test_a_report_tells_what_was_counted() -> None:
    health = board()
    watch = health.open_reader()
    arrive(watch, 0, now_s=101.0)
    arrive(watch, 2, now_s=102.0)
    health.count("epochs", 2)
    health.count("epochs")
    health.refuse("garbage", 102.0)
    report = health.report(7, 103.5)
    assert (report.t_ns, report.service, report.boot_id, report.uptime_s) == (7, "gnss_correction", "boot", 3.5)
    assert (report.level, report.refused, report.counts) == ("degraded", 1, {"epochs": 3})
    (entry,) = report.inputs
    assert (entry.key, entry.source) == (KEY, "source")
    assert (entry.received, entry.missing, entry.duplicated, entry.restarts) == (2, 1, 0, 0)
    assert entry.age_s == pytest.approx(1.5)
    assert entry.delay_s == pytest.approx(0.002)


def test_each_reader_sees_each_message_once() -> None:
    health = board()
    watches = [health.open_reader(), health.open_reader()]
    assert all(arrive(watch, 0) for watch in watches)
    arrive(watches[1], 5)
    # One line per input: what the reader in more trouble saw.
    assert [(entry.received, entry.missing) for entry in health.report(0, 100.0).inputs] == [(2, 4)]


def test_a_report_is_bounded_and_shows_the_troubled_first() -> None:
    health = board()
    watch = health.open_reader()
    for number in range(MAX_SHOWN + 10):
        arrive(watch, 0, key=f"{KEY}/{number}")
    arrive(watch, 2, key=f"{KEY}/{MAX_SHOWN + 9}")
    inputs = health.report(0, 100.0).inputs
    assert len(inputs) == MAX_SHOWN
    assert inputs[0].key == f"{KEY}/{MAX_SHOWN + 9}"


def test_notices_are_bounded() -> None:
    health = board()
    watch = health.open_reader()
    for number in range(MAX_NOTICES + 10):
        arrive(watch, 2 * number)
    assert len(health.take_notices()) == MAX_NOTICES


def test_reasons_of_refusals_are_short() -> None:
    health = board()
    health.refuse("x" * 10_000, 100.0)
    assert all(len(reason) < 400 for reason in health.level(100.0)[1])
