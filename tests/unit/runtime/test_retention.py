"""What a sender keeps for those who were away."""

from __future__ import annotations

from schemas.retention import RetainedQuestion
from services.runtime.retention import OVERHEAD_BYTES, Retention

KEY, OTHER = "kirotei/v1/demo/train/T1/slip", "kirotei/v1/demo/train/T1/run"


def filled(count: int, *, most_s: float = 600.0, most_bytes: int = 10**9, step_s: float = 0.0) -> Retention:
    """A retention that has been told of `count` publications, one every `step_s`."""
    retention = Retention("boot", most_s, most_bytes)
    for number in range(count):
        retention.keep(KEY, number, b"%d" % number, b"", number * step_s)
    return retention


def wanted(first: int, last: int, boot_id: str = "boot", most_bytes: int = 1000) -> RetainedQuestion:
    return RetainedQuestion(t_ns=0, boot_id=boot_id, wanted={KEY: (first, last)}, most_bytes=most_bytes)


def test_what_is_wanted_is_given_in_order() -> None:
    answer = filled(10).answer(wanted(3, 6), 5.0, 7)
    assert [record.payload for record in answer.records] == [b"3", b"4", b"5", b"6"]
    assert (answer.kept, answer.more, answer.t_ns) == ({KEY: (0, 9)}, False, 7)


def test_more_than_fits_comes_page_by_page() -> None:
    retention = filled(10)
    page = len(KEY) + 1
    found: list[bytes] = []
    while True:
        answer = retention.answer(wanted(len(found), 9, most_bytes=4 * page), 5.0, 0)
        found += [record.payload for record in answer.records]
        if not answer.more:
            break
    assert found == [b"%d" % number for number in range(10)]


def test_one_record_is_given_however_large() -> None:
    answer = filled(3).answer(wanted(0, 2, most_bytes=1), 5.0, 0)
    assert ([record.payload for record in answer.records], answer.more) == ([b"0"], True)


def test_the_oldest_go_by_bytes_over_all_keys() -> None:
    retention = Retention("boot", 600.0, 3 * (OVERHEAD_BYTES + 1))
    for number in range(3):
        retention.keep(KEY, number, b"x", b"", 0.0)
    retention.keep(OTHER, 0, b"y", b"", 0.0)
    answer = retention.answer(RetainedQuestion(t_ns=0), 5.0, 0)
    assert answer.kept == {KEY: (1, 2), OTHER: (0, 0)}


def test_the_oldest_go_by_age() -> None:
    retention = filled(10, most_s=4.0, step_s=1.0)
    assert retention.answer(RetainedQuestion(t_ns=0), 11.0, 0).kept == {KEY: (7, 9)}
    assert retention.answer(RetainedQuestion(t_ns=0), 100.0, 0).kept == {}


def test_what_was_just_said_is_no_gap_yet() -> None:
    retention = filled(10, step_s=1.0)
    assert retention.answer(RetainedQuestion(t_ns=0), 9.5, 0).kept == {KEY: (0, 8)}
    assert retention.answer(RetainedQuestion(t_ns=0), 0.5, 0).kept == {KEY: (0, -1)}


def test_another_start_gives_nothing() -> None:
    answer = filled(10).answer(wanted(0, 9, boot_id="earlier"), 5.0, 0)
    assert (answer.boot_id, answer.records, answer.more) == ("boot", (), False)


def test_absurd_wishes_give_what_there_is() -> None:
    assert filled(3).answer(wanted(5, 2), 5.0, 0).records == ()
    assert len(filled(3).answer(wanted(-7, 10**18), 5.0, 0).records) == 3
