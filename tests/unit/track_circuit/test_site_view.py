"""What the circuits of a site say, in lines and in a table."""

from __future__ import annotations

from typing import Literal

import numpy as np
from rich.console import Console

from schemas.track_circuit import CircuitEvent, CircuitOccupancy, EqualiserState, Telegram
from services.track_circuit.site_view import STALE_S, SiteView, render, status_line

State = Literal["clear", "occupied"]


def occupancy(state: State, level_db: float | None, *, restrictive: bool = False) -> CircuitOccupancy:
    return CircuitOccupancy(
        t_ns=0,
        circuit="T1",
        state=state,
        reason="",
        level_db=level_db,
        reference_db=-20.0,
        most_restrictive=restrictive,
        since_ns=0,
    )


def telegram(state: Literal["good", "bad_crc"]) -> Telegram:
    return Telegram(
        t_ns=0,
        circuit="T1",
        scheme="ss-cdma",
        state=state,
        sequence=1,
        circuit_id=1,
        payload=b"",
        crc_ok=state == "good",
        evm_db=-12.5,
        level_db=-21.0,
        receiver="mlse",
    )


def equaliser(receiver: str) -> EqualiserState:
    none = np.empty(0)
    return EqualiserState(
        t_ns=0,
        circuit="T1",
        receiver=receiver,
        taps=none.astype(np.complex128),
        error_db=none,
        constellation=none.astype(np.complex128),
        carrier_offset_hz=0.0,
        clock_offset_ppm=0.0,
        from_store=False,
    )


def test_lines_tell_state_level_and_telegrams_of_the_last_seconds() -> None:
    site = SiteView()
    assert site.take("T1", occupancy("clear", -21.0), 10.0) == ""
    for t_s, state in ((10.0, "bad_crc"), (14.0, "good"), (15.0, "good"), (15.5, "bad_crc")):
        site.take("T1", telegram("good" if state == "good" else "bad_crc"), t_s)
    line = status_line(site.circuits["T1"], 15.6)
    state, said = line[:38], line[39:]
    assert state.split() == ["T1", "clear"]
    assert said == "level -21.0 dB (reference -20.0 dB), EVM -12.5 dB, telegrams of 5 s: 2 good, 1 not"
    # Nothing heard for a while: not believed any more.
    assert "silent" in status_line(site.circuits["T1"], 15.5 + STALE_S + 0.1)


def test_events_are_lines_of_a_log_counted_from_the_first_word() -> None:
    site = SiteView()
    site.take("T1", occupancy("occupied", None, restrictive=True), 100.0)
    event = CircuitEvent(t_ns=0, circuit="T1", kind="telegrams_lost", text="no good telegram in time")
    line = site.take("T1", event, 132.5)
    assert line.split() == ["32.5", "s", "T1", "telegrams_lost", "no", "good", "telegram", "in", "time"]


def test_the_table_shows_every_circuit_and_its_events() -> None:
    site, console = SiteView(), Console(width=160)
    with console.capture() as nothing:
        console.print(render(site, "demo", 0.0))
    assert "nothing heard yet" in nothing.get()
    for k, level in enumerate((-20.0, -32.0, None)):
        site.take("T1", occupancy("occupied", level, restrictive=True), float(k))
    site.take("T2", occupancy("clear", -20.0), 2.0)
    site.take("T1", equaliser("lms"), 2.0)
    site.take("T1", CircuitEvent(t_ns=0, circuit="T1", kind="occupied", text="level low"), 2.0)
    with console.capture() as shown:
        console.print(render(site, "demo", 2.0))
    text = shown.get()
    assert "occupied, most restrictive" in text
    assert "█▅·" in text
    assert "level low" in text
    assert "lms" in text
    assert text.index("T1") < text.index("T2")
