"""Tokens that come and go become services that live or are lost."""

from __future__ import annotations

import pytest

from schemas.topic import Place
from services.runtime.alive import AliveChange, AliveTable, Token, token_of, tokens_anywhere, tokens_of
from services.runtime.key_expression import intersects

TRAIN = Place("demo", "train", "T1")
A, B = Token(TRAIN, "recorder", "a"), Token(TRAIN, "recorder", "b")


def test_a_key_is_read_back() -> None:
    token = Token(TRAIN, "gnss_receiver@rear", "0123")
    assert token_of(token.key) == token
    assert intersects(tokens_of(TRAIN, "gnss_receiver@rear"), token.key)
    assert not intersects(tokens_of(TRAIN, "gnss_receiver"), token.key)
    assert intersects(tokens_anywhere("demo"), token.key)
    assert not intersects(tokens_anywhere("other"), token.key)


@pytest.mark.parametrize(
    "key",
    [
        "kirotei/v1/demo/train/T1/alive/recorder",
        "kirotei/v2/demo/train/T1/alive/recorder/a",
        "kirotei/v1/demo/ship/T1/alive/recorder/a",
        "kirotei/v1/demo/train/$/alive/recorder/a",
        "kirotei/v1/demo/train/T1/dead/recorder/a",
    ],
)
def test_other_keys_are_no_tokens(key: str) -> None:
    assert token_of(key) is None


def test_a_service_appears_once() -> None:
    table = AliveTable()
    table.came(A)
    table.came(A)
    assert table.changes(0.0) == [AliveChange(A, alive=True)]
    assert table.changes(1.0) == []
    assert table.next_due_s() is None


def test_a_router_restart_loses_nobody() -> None:
    table = AliveTable()
    table.came(A)
    table.changes(0.0)
    table.went(A, 10.0)
    assert table.changes(12.5) == []
    assert table.next_due_s() == 15.0
    table.came(A)
    assert table.changes(20.0) == []


def test_a_service_is_lost_after_five_seconds() -> None:
    table = AliveTable()
    table.came(A)
    table.changes(0.0)
    table.went(A, 10.0)
    assert table.changes(14.9) == []
    assert table.changes(15.0) == [AliveChange(A, alive=False)]
    assert table.changes(16.0) == []
    table.came(A)
    assert table.changes(17.0) == [AliveChange(A, alive=True)]


def test_a_restarted_service_is_another_start_and_never_lost() -> None:
    table = AliveTable()
    table.came(A)
    table.changes(0.0)
    table.came(B)
    table.went(A, 1.0)
    assert table.changes(1.0) == [AliveChange(B, alive=True)]
    assert table.changes(100.0) == []


def test_a_token_that_only_flashed_up_is_no_news() -> None:
    table = AliveTable()
    table.came(A)
    table.went(A, 1.0)
    assert table.changes(1.0) == []
    assert table.changes(6.0) == []
    assert table.next_due_s() is None


def test_a_token_that_was_never_seen_may_vanish() -> None:
    table = AliveTable()
    table.went(A, 1.0)
    assert table.changes(10.0) == []
