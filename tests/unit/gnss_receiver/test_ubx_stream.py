"""UBX streams: raw measurements, broadcast messages, the receiver's own position."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas.gnss import Ephemeris, Epoch, Ionosphere, OwnPosition
from schemas.gnss_time import unix_ns_from_gps
from tests.unit.gnss_receiver.broadcast_samples import (
    beidou_subframes,
    glonass,
    glonass_strings,
    inav_pages,
    kepler,
    lnav_ionosphere,
    lnav_subframes,
)
from tests.unit.gnss_receiver.stream_samples import (
    NEAR_NS,
    TOW_S,
    WEEK,
    Row,
    listen,
    pvt,
    rawx,
    sfrbx,
    ubx,
)

GOOD = 7
ROWS: list[Row] = [
    (0, 10, 0, 20_576_396.77, 108_129_693.934, 1064.326, 64_500, 51, GOOD),
    (0, 10, 3, 20_576_399.569, 84_256_913.85, 829.762, 2_000, 40, GOOD),
    (1, 133, 0, 37_509_265.021, 197_112_523.041, 318.22, 900, 39, GOOD),
    (2, 7, 1, 23_205_808.406, 121_947_341.562, -585.078, 5_000, 48, GOOD),
    (3, 21, 5, 22_516_779.605, 117_251_028.331, 12.5, 5_000, 45, GOOD),
    (5, 2, 0, 37_000_123.5, 194_436_001.125, 3.25, 5_000, 38, GOOD),
    (6, 9, 0, 21_150_376.213, 113_019_118.5, -2000.5, 5_000, 44, GOOD),
]
NAMES = ["G10", "G10", "S33", "E07", "C21", "J02", "R09"]
SIGNALS = ["1C", "2L", "1C", "1B", "1P", "1C", "1C"]


def one_epoch(stream: bytes) -> Epoch:
    (found,) = (one for one in listen(stream)[0] if isinstance(one, Epoch))
    return found


def test_raw_measurements_become_an_epoch() -> None:
    found = one_epoch(rawx(ROWS, 455_617.998))
    assert (found.gps_week, found.tow_s, found.t_ns) == (WEEK, 455_617.998, unix_ns_from_gps(WEEK, 455_617.998))
    assert list(found.satellites) == NAMES
    assert list(found.signals) == SIGNALS
    assert found.pseudorange_m.tolist() == [row[3] for row in ROWS]
    assert found.carrier_phase_cycles.tolist() == [row[4] for row in ROWS]
    assert np.allclose(found.doppler_hz, [row[5] for row in ROWS], rtol=1e-7)  # single precision on the wire
    assert found.cn0_dbhz.tolist() == [row[7] for row in ROWS]
    assert not found.lock_lost.any()


@pytest.mark.parametrize(
    ("tracking", "ranged", "phased", "lost"),
    [(7, True, True, 0), (3, True, True, 2), (1, True, False, 0), (6, False, True, 0), (0, False, False, 0)],
)
def test_what_the_receiver_does_not_vouch_for_is_missing(tracking: int, ranged: bool, phased: bool, lost: int) -> None:  # noqa: FBT001 - a table of cases
    found = one_epoch(rawx([(*ROWS[0][:8], tracking)]))
    assert np.isfinite(found.pseudorange_m[0]) == ranged
    assert np.isfinite(found.carrier_phase_cycles[0]) == phased
    assert found.lock_lost[0] == lost


def locks(*steps: tuple[float, int], status: int = 1) -> list[int]:
    """Loss-of-lock indicators of one satellite seen at times with lock counters [ms]."""
    stream = b"".join(rawx([(*ROWS[0][:6], lock_ms, 51, GOOD)], TOW_S + t_s, status=status) for t_s, lock_ms in steps)
    return [int(one.lock_lost[0]) for one in listen(stream)[0] if isinstance(one, Epoch)]


def test_lock_counters_tell_when_a_carrier_began_anew() -> None:
    assert locks((0.0, 100), (0.25, 350), (0.5, 600)) == [0, 0, 0]
    assert locks((0.0, 0), (0.25, 0), (0.5, 250)) == [1, 1, 0]
    assert locks((0.0, 9_000), (0.25, 240)) == [0, 1]
    # Lost and locked again while away: the counter is higher than before, but lower than it would be.
    assert locks((0.0, 5_000), (20.0, 9_000)) == [0, 1]
    assert locks((0.0, 64_500), (3600.0, 64_500)) == [0, 0]
    assert locks((0.0, 64_500), (-50.0, 64_500)) == [0, 1]
    assert locks((0.0, 64_500), (0.25, 64_500), status=3) == [1, 1]


def test_unknown_satellites_and_signals_are_left_out_and_counted() -> None:
    rows: list[Row] = [(6, 255, 0, *ROWS[0][3:]), (0, 10, 9, *ROWS[0][3:]), (4, 1, 0, *ROWS[0][3:]), ROWS[0]]
    heard, receiver = listen(rawx(rows))
    assert isinstance(heard[0], Epoch)
    assert heard[0].satellites == ("G10",)
    assert receiver.counts["unknown_signals"] == 3


def test_a_receiver_that_does_not_know_the_time_gives_no_epoch() -> None:
    heard, receiver = listen(rawx(ROWS, 12.0, 0) + rawx(ROWS, float("nan")) + rawx(ROWS, -5.0) + rawx(ROWS)[:0])
    assert heard == []
    assert receiver.counts["bad_ubx_RXM-RAWX"] == 3


def test_a_clock_that_runs_ahead_at_the_end_of_the_week_is_in_the_next_one() -> None:
    found = one_epoch(rawx(ROWS, 604_800.25))
    assert (found.gps_week, found.tow_s) == (WEEK + 1, 0.25)


def test_messages_cut_short_are_refused() -> None:
    whole = rawx(ROWS)[6:-2]
    stream = b"".join(ubx(b"\x02\x15", whole[:length]) for length in range(0, len(whole), 3))
    stream += (
        ubx(b"\x02\x13", b"\0\x05\0\x07\x0a\0\x02\0" + bytes(39))
        + ubx(b"\x02\x13", b"\0")
        + ubx(b"\x01\x07", bytes(20))
    )
    heard, receiver = listen(stream)
    assert heard == []
    assert receiver.counts["bad_ubx_RXM-SFRBX"] == 2
    assert receiver.counts["bad_ubx_RXM-RAWX"] == len(range(0, len(whole), 3))
    assert receiver.counts["bad_ubx_NAV-PVT"] == 1


@settings(max_examples=200)
@given(st.sampled_from([b"\x02\x15", b"\x02\x13", b"\x01\x07", b"\x0d\x01", b"\xf0\x00"]), st.binary(max_size=150))
def test_no_message_makes_it_fail(kind: bytes, message: bytes) -> None:
    listen(ubx(kind, message))


def test_broadcast_messages_of_all_systems_become_ephemerides() -> None:
    stream = b"".join(
        [
            *(sfrbx(0, 5, 0, words) for words in lnav_subframes(kepler("G05"))),
            *(sfrbx(5, 2, 0, words) for words in lnav_subframes(kepler("J02"))),
            *(sfrbx(2, 21, 1, words) for words in inav_pages(kepler("E21"))),
            *(sfrbx(3, 30, 0, words) for words in beidou_subframes(kepler("C30"))),
            *(sfrbx(6, 9, 0, words, channel=5) for words in glonass_strings(glonass())),
            sfrbx(0, 5, 0, lnav_ionosphere((1, 1, 1, 1), (1, 1, 1, 1))),
        ]
    )
    heard, receiver = listen(rawx(ROWS) + stream + stream)
    assert [one.satellite for one in heard if isinstance(one, Ephemeris)] == ["G05", "J02", "E21", "C30", "R09"]
    assert sum(isinstance(one, Ionosphere) for one in heard) == 2
    # Galileo's pages say the same without end, and are not looked at again.
    assert receiver.counts["ephemerides_repeated"] == 4
    (found,) = (one for one in heard if isinstance(one, Ephemeris) and one.satellite == "R09")
    assert found.gps_week == WEEK
    assert found.toe_s == glonass().toe_s


def test_a_change_of_health_is_said() -> None:
    frames = (lnav_subframes(kepler("G05", healthy=healthy)) for healthy in (True, False))
    heard, _ = listen(rawx(ROWS) + b"".join(sfrbx(0, 5, 0, words) for frame in frames for words in frame))
    assert [one.healthy for one in heard if isinstance(one, Ephemeris)] == [True, False]


def test_what_is_not_read_is_counted_by_its_name() -> None:
    words = lnav_subframes(kepler("G05"))[0]
    stream = sfrbx(6, 9, 0, words[:4]) + ubx(b"\x0a\x04", b"") + ubx(b"\x77\x88", b"")
    _, receiver = listen(stream)
    for name in ("bad_ubx_RXM-SFRBX", "not_read_ubx_MON-VER", "not_read_ubx_7788"):
        assert receiver.counts[name] == 1, name


def position(message: bytes) -> OwnPosition:
    ((found,), _) = listen(message)
    assert isinstance(found, OwnPosition)
    return found


def test_the_receivers_own_position() -> None:
    found = position(pvt())
    assert (found.protocol, found.status, found.mode) == ("ubx", "fix", "rtk_fixed")
    assert found.t_ns == NEAR_NS - 1_000_000
    assert (found.lat_deg, found.lon_deg, found.h_m) == (31.18, 121.4, 25.0)
    assert (found.ve_mps, found.vn_mps, found.vu_mps) == (-4.0, 3.0, -0.5)
    assert (found.sigma_horizontal_m, found.sigma_vertical_m, found.satellites_used) == (1.2, 2.5, 12)
    assert found.correction_age_s == 15.0


@pytest.mark.parametrize(
    ("fix_type", "flags", "status", "mode"),
    [
        (3, 0x01, "fix", "autonomous"),
        (2, 0x03, "fix", "differential"),
        (4, 0x43, "fix", "rtk_float"),
        (1, 0x01, "predicted", "estimated"),
        (3, 0x00, "none", "none"),
        (0, 0x00, "none", "none"),
        (5, 0x01, "none", "none"),
    ],
)
def test_a_position_is_called_what_it_is(fix_type: int, flags: int, status: str, mode: str) -> None:
    found = position(pvt(fix_type, flags))
    assert (found.status, found.mode) == (status, mode)
    assert (found.lat_deg is None) == (status == "none")


def test_no_position_without_a_time_but_with_a_leap_second() -> None:
    assert listen(pvt(valid=2))[0] == []
    assert position(pvt(second=60)).t_ns == NEAR_NS + 40 * 10**9 - 1_000_000
