from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.radio_probe.modem_answers import (
    RSCP,
    RSRP,
    RSRQ,
    RXLEV,
    SS_RSRP,
    SS_RSRQ,
    SS_SINR,
    Scale,
    SignalReport,
    report_of,
)
from services.radio_probe.modem_dialogue import ANSWER_S, GIVEN_UP, ModemDialogue


@pytest.mark.parametrize(
    ("scale", "last", "second_lowest", "second_highest"),
    [
        (RXLEV, 63, (-110.0, -109.0), (-49.0, -48.0)),
        (RSCP, 96, (-120.0, -119.0), (-26.0, -25.0)),
        (RSRQ, 34, (-19.5, -19.0), (-3.5, -3.0)),
        (RSRP, 97, (-140.0, -139.0), (-45.0, -44.0)),
        (SS_RSRQ, 127, (-43.0, -42.5), (19.5, 20.0)),
        (SS_RSRP, 126, (-156.0, -155.0), (-32.0, -31.0)),
        (SS_SINR, 127, (-23.0, -22.5), (39.5, 40.0)),
    ],
)
def test_steps_are_those_of_the_standard(
    scale: Scale, last: int, second_lowest: tuple[float, float], second_highest: tuple[float, float]
) -> None:
    assert scale.last == last
    assert (scale.value(0), scale.value(last)) == (scale.low, scale.high)
    assert scale.value(1) == sum(second_lowest) / 2
    assert scale.value(last - 1) == sum(second_highest) / 2
    assert scale.value(scale.unknown) is None
    assert scale.value(last + 1) is None


@pytest.mark.parametrize(
    ("line", "report"),
    [
        ("+CSQ: 31,99", SignalReport("CSQ", rssi_dbm=-51.0)),
        ("+CSQ: 0,0", SignalReport("CSQ", rssi_dbm=-113.0)),
        ("+CSQ: 99,99", SignalReport("CSQ")),
        ("+CSQ: 45,0", None),
        ("+CESQ: 99,99,255,255,20,80", SignalReport("CESQ", None, -60.5, -9.75, technology="LTE")),
        ("+CESQ: 40,2,255,255,255,255", SignalReport("CESQ", rssi_dbm=-70.5, technology="GSM")),
        ("+CESQ: 99,99,50,30,255,255", SignalReport("CESQ", rsrp_dbm=-70.5, technology="WCDMA")),
        (
            "+CESQ: 99,99,255,255,255,255,65,70,80",
            SignalReport("CESQ", None, -86.5, -10.75, 16.75, technology="NR"),
        ),
        ("+CESQ: 99,99,255,255", None),
        ('+QCSQ: "LTE",-52,-81,195,-10', SignalReport("QCSQ", -52.0, -81.0, -10.0, 19.0, technology="LTE")),
        ('+QCSQ: "NOSERVICE"', SignalReport("QCSQ", technology="NOSERVICE")),
        ('+QCSQ: "LTE",-52', None),
        ('+CEREG: 2,1,"1A2B","01c0ffee",7', SignalReport("CEREG", cell="01C0FFEE")),
        ('+CEREG: 1,"1A2B","01C0FFEE",7', SignalReport("CEREG", cell="01C0FFEE")),
        ("+CEREG: 2,0", None),
        ("RING", None),
    ],
)
def test_answers(line: str, report: SignalReport | None) -> None:
    assert report_of(line) == report


@given(st.text(max_size=300), st.sampled_from(["", "+CSQ: ", "+CESQ: ", "+QCSQ: ", '+QCSQ: "LTE",', "+CEREG: "]))
def test_garbage_is_no_answer_and_no_crash(text: str, before: str) -> None:
    report = report_of(before + text)
    for value in (report.rssi_dbm, report.rsrp_dbm) if report and report.command != "QCSQ" else ():
        assert value is None or -160.0 <= value <= 0.0


@given(st.lists(st.integers(-1000, 1000), min_size=6, max_size=9))
def test_any_numbers_stay_on_the_scales(numbers: list[int]) -> None:
    report = report_of("+CESQ: " + ",".join(map(str, numbers)))
    assert report is not None
    assert report.rssi_dbm is None or -110.0 <= report.rssi_dbm <= -48.0
    assert report.rsrp_dbm is None or -156.0 <= report.rsrp_dbm <= -25.0
    assert report.rsrq_db is None or -43.0 <= report.rsrq_db <= 20.0


def test_one_report_a_turn_and_a_command_that_is_not_known_is_dropped() -> None:
    dialogue = ModemDialogue(("AT+CSQ", "AT+QCSQ"), every_s=1.0)
    dialogue.begin(0.0)
    reports = []
    for turn in range(GIVEN_UP + 1):
        assert dialogue.next_command(float(turn)) == b"AT+CSQ\r\n"
        assert dialogue.next_command(float(turn)) is None
        reports += dialogue.feed(b"AT+CSQ\r\r\n+CSQ: 20,99\r\n\r\nOK\r\n")
        if turn < GIVEN_UP:
            assert dialogue.next_command(turn + 0.1) == b"AT+QCSQ\r\n"
            reports += dialogue.feed(b"\r\nERROR\r\n")
        assert dialogue.next_command(turn + 0.2) is None
    assert [one.rssi_dbm for one in reports] == [-73.0] * (GIVEN_UP + 1)
    assert dialogue.given_up == ("AT+QCSQ",)


def test_a_silent_modem_is_asked_the_next_thing_after_a_while() -> None:
    dialogue = ModemDialogue(("AT+CSQ", "AT+CESQ"), every_s=10.0)
    dialogue.begin(0.0)
    assert dialogue.next_command(0.0) == b"AT+CSQ\r\n"
    assert dialogue.next_command(ANSWER_S - 0.1) is None
    assert dialogue.next_command(ANSWER_S) == b"AT+CESQ\r\n"
    assert dialogue.counts["unanswered"] == 1


def test_answers_may_come_in_pieces() -> None:
    dialogue = ModemDialogue(("AT+CSQ",), every_s=1.0)
    dialogue.begin(0.0)
    dialogue.next_command(0.0)
    found = []
    for octet in b"\r\n+CSQ: 20,99\r\n\r\nOK\r\n":
        found += dialogue.feed(bytes([octet]))
    assert [one.rssi_dbm for one in found] == [-73.0]


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_any_bytes_leave_the_dialogue_whole(chunks: list[bytes]) -> None:
    dialogue = ModemDialogue(("AT+CSQ",), every_s=1.0)
    dialogue.begin(0.0)
    for chunk in chunks:
        dialogue.feed(chunk)
    dialogue.feed(b"\n")
    # Noise that holds a line "OK" or "ERROR" may answer the first command; the next turn comes all the same.
    for now_s in (0.0, 1.0 + ANSWER_S, 2.0 + 2 * ANSWER_S):
        command = dialogue.next_command(now_s)
    assert command == b"AT+CSQ\r\n"
    assert [one.rssi_dbm for one in dialogue.feed(b"+CSQ: 20,99\r\nOK\r\n")] == [-73.0]
