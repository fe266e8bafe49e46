"""RTCM 3 streams: epochs put together, weeks and leap seconds, faults of every kind."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from schemas.gnss import Ephemeris, Epoch
from schemas.gnss_time import gps_from_unix_ns, unix_ns_from_gps
from services.gnss_receiver.bit_fields import BitWriter
from services.gnss_receiver.heard import StationPosition
from services.gnss_receiver.rtcm_ephemerides import write_ephemeris
from services.gnss_receiver.rtcm_messages import framed, read_fields, write_fields
from services.gnss_receiver.rtcm_msm_writing import MsmWriter
from services.gnss_receiver.rtcm_station import read_station, write_station
from services.gnss_receiver.rtcm_stream import RtcmStream
from services.gnss_receiver.rtcm_time import epoch_gps_ms, gps_ms_from_unix_ns, gps_ms_of_day, unix_ns_from_gps_ms
from tests.unit.gnss_receiver.broadcast_samples import glonass, kepler
from tests.unit.gnss_receiver.stream_samples import (
    CHANNELS,
    NEAR_NS,
    ROWS,
    TOW_S,
    WEEK,
    assert_same_epoch,
    epoch,
    listen,
    rtcm_of,
)

WEEK_S, WEEK_MS = 604_800, 604_800_000
EPOCHS = [epoch(TOW_S + second) for second in range(4)]
STREAM = rtcm_of(EPOCHS)
NAMES = sorted(name for name, _, _ in ROWS)


def epochs_in(stream: bytes, chunk: int = 100_000, near_ns: int = NEAR_NS) -> tuple[list[Epoch], Counter[str]]:
    heard, receiver = listen(stream, chunk, near_ns)
    return [one for one in heard if isinstance(one, Epoch)], receiver.counts


@pytest.mark.parametrize("chunk", [1, 7, 100, 100_000])
def test_epochs_come_out_as_they_went_in(chunk: int) -> None:
    found, counts = epochs_in(b"".join(STREAM), chunk)
    assert len(found) == 4
    for one, wanted in zip(found, EPOCHS, strict=True):
        assert_same_epoch(one, wanted, NAMES)
    assert counts["epochs"] == 4
    assert not [name for name in counts if name.startswith(("bad", "epochs_without", "repeated"))]


def test_phases_move_with_the_pseudoranges() -> None:
    found, _ = epochs_in(b"".join(STREAM))
    for earlier, later in pairwise(found):
        advance = later.carrier_phase_cycles - earlier.carrier_phase_cycles
        # 100 m/s over 1 s, in cycles: Doppler is minus that. Phases are rounded to 0.14 mm, a thousandth of a cycle.
        assert np.allclose(advance, -earlier.doppler_hz, rtol=0, atol=0.003)
        assert not later.lock_lost.any()


@pytest.mark.parametrize("cut", range(0, len(STREAM[1]), 5))
def test_a_stream_cut_mid_frame_gives_the_rest(cut: int) -> None:
    found, counts = epochs_in(STREAM[0] + STREAM[1][:cut] + STREAM[2] + STREAM[3])
    assert [one.tow_s for one in found if one.tow_s != TOW_S + 1] == [TOW_S, TOW_S + 2, TOW_S + 3]
    for one, wanted in zip([one for one in found if one.tow_s != TOW_S + 1], (EPOCHS[0], *EPOCHS[2:]), strict=True):
        assert_same_epoch(one, wanted, NAMES)
    cut_epochs = [one for one in found if one.tow_s == TOW_S + 1]
    assert counts["epochs_without_end"] == len(cut_epochs) <= 1
    for one in cut_epochs:
        index = {name: at for at, name in enumerate(EPOCHS[1].satellites)}
        places = [index[name] for name in one.satellites if name != "G03"]
        others = [at for at, name in enumerate(one.satellites) if name != "G03"]
        assert np.allclose(one.pseudorange_m[others], EPOCHS[1].pseudorange_m[places], rtol=0, atol=0.0003)


@settings(max_examples=100)
@given(st.lists(st.tuples(st.integers(0, sum(map(len, STREAM)) - 1), st.integers(0, 7)), min_size=1, max_size=6))
def test_flipped_bits_never_give_wrong_measurements(flips: list[tuple[int, int]]) -> None:
    stream = bytearray(b"".join(STREAM))
    for place, bit in flips:
        stream[place] ^= 1 << bit
    found, _ = epochs_in(bytes(stream))
    by_time = {one.tow_s: one for one in EPOCHS}
    for one in found:
        wanted = by_time[one.tow_s]
        truth = dict(zip(zip(wanted.satellites, wanted.signals, strict=True), wanted.pseudorange_m, strict=True))
        for name, range_m in zip(zip(one.satellites, one.signals, strict=True), one.pseudorange_m, strict=True):
            assert range_m == pytest.approx(truth[name], abs=3e-4)


def test_an_epoch_whose_last_message_is_lost_ends_with_the_next() -> None:
    messages = MsmWriter(5).messages(EPOCHS[0], CHANNELS)
    found, counts = epochs_in(b"".join(framed(one) for one in messages[:-1]) + STREAM[1])
    assert [len(one.satellites) for one in found] == [len(ROWS) - 1, len(ROWS)]
    assert counts["epochs_without_end"] == 1


def test_a_sender_that_always_announces_the_end_is_seen_through() -> None:
    # Every message has the multiple-message bit off: after three epochs cut short, time alone counts.
    stream = b""
    for one in [epoch(TOW_S + second) for second in range(8)]:
        for message in MsmWriter(5).messages(one, CHANNELS):
            content = bytearray(message)
            content[6] &= ~0b0000_0010
            stream += framed(bytes(content))
    found, counts = epochs_in(stream)
    assert [len(one.satellites) for one in found] == [2, 2, 2, 2, 7, 7, 7]
    assert counts["messages_after_end"] == 4 * 5


def test_repeated_messages_are_no_epochs() -> None:
    found, counts = epochs_in(STREAM[0] + STREAM[0] + STREAM[1])
    assert [one.tow_s for one in found] == [TOW_S, TOW_S + 1]
    assert counts["repeated_messages"] == 6
    messages = [framed(one) for one in MsmWriter(5).messages(EPOCHS[0], CHANNELS)]
    found, counts = epochs_in(messages[0] + b"".join(messages))
    assert [len(one.satellites) for one in found] == [len(ROWS)]
    assert counts["repeated_cells"] == 2


def test_a_receiver_that_begins_anew_loses_its_lock() -> None:
    # The clock jumps back by an hour; every carrier is a new one.
    later = [epoch(TOW_S - 3600.0 + second) for second in range(2)]
    found, counts = epochs_in(b"".join(STREAM) + b"".join(rtcm_of(later)))
    assert [one.tow_s for one in found[4:]] == [TOW_S - 3600.0, TOW_S - 3599.0]
    assert found[4].lock_lost.tolist() == [1] * len(ROWS)
    assert counts["time_jumps_back"] == 1


def test_lost_lock_is_seen_even_when_the_counter_has_caught_up() -> None:
    steps = [epoch(TOW_S + second, lost=[second == 60, *[0] * (len(ROWS) - 1)]) for second in range(61)]
    frames = rtcm_of(steps)
    # Epochs 20 to 119 are lost, in which the carrier was lost and locked again for as long as it was before.
    later = rtcm_of([*steps, *(epoch(TOW_S + second) for second in range(61, 130))])
    found, _ = epochs_in(b"".join(frames[:20]) + b"".join(later[120:]))
    assert found[20].lock_lost.tolist() == [1, *[0] * (len(ROWS) - 1)]
    assert not found[21].lock_lost.any()


def test_half_cycles_are_told() -> None:
    (frame,) = rtcm_of([epoch(lost=[2, *[0] * (len(ROWS) - 1)])])
    (found,), _ = epochs_in(frame)
    assert found.lock_lost[list(zip(found.satellites, found.signals, strict=True)).index(("G03", "1C"))] == 3


def test_glonass_channels_come_from_ephemerides_too() -> None:
    rows = [("R09", "1C", 2.1e7)]
    bare = MsmWriter(5, 4).messages(epoch(rows=rows), {"R09": -2})
    known = MsmWriter(5, 4).messages(epoch(TOW_S + 1, rows=rows), {"R09": -2})
    stream = framed(bare[0]) + framed(write_ephemeris(glonass())) + framed(known[0])
    found, _ = epochs_in(stream)
    assert np.isnan(found[0].carrier_phase_cycles).all()
    assert np.isfinite(found[1].carrier_phase_cycles).all()


def test_ephemerides_come_once_and_fnav_only_without_inav() -> None:
    inav = write_ephemeris(kepler("E21"))
    fnav = write_fields(1045, read_fields(inav) | {"DF291": 107})
    first = b"".join(map(framed, (fnav, inav, inav, fnav)))
    heard, receiver = listen(first + framed(write_fields(1045, read_fields(inav) | {"DF291": 108})))
    assert [type(one) for one in heard] == [Ephemeris, Ephemeris]
    assert receiver.counts["ephemerides_repeated"] == 2
    assert receiver.counts["fnav_left_out"] == 1


def test_positions_of_the_station() -> None:
    wanted = StationPosition(1665, (-2845676.411, 4661619.4022, 3283215.3241))
    high = replace_height(wanted)
    heard, _ = listen(framed(write_station(wanted)) + framed(write_station(high)))
    assert heard == [wanted, high]
    assert read_station(1005, write_station(wanted)) == wanted
    with pytest.raises(ValueError, match="DF025"):
        write_station(StationPosition(0, (1e9, 0.0, 0.0)))


def replace_height(position: StationPosition) -> StationPosition:
    return StationPosition(position.station, position.position_m, 1.2345)


def test_messages_that_are_not_read_are_counted_by_their_number() -> None:
    unknown = framed((1033 << 4).to_bytes(2, "big") + b"hello")
    short = framed(b"\x43")
    bad = framed(MsmWriter(5).messages(EPOCHS[0], CHANNELS)[0][:30])
    cut_ephemeris = framed(write_ephemeris(kepler("G05"))[:20])
    late = BitWriter()
    late.uint(1077, 12)
    late.uint(0, 12)
    late.uint(WEEK_MS, 30)
    late.uint(0, 200)
    heard, receiver = listen(unknown + short + bad + cut_ephemeris + framed(late.content()) + STREAM[0])
    assert len(heard) == 1
    for name in ("not_read_rtcm_1033", "not_read_rtcm_0", "bad_rtcm_1019"):
        assert receiver.counts[name] == 1
    assert receiver.counts["bad_rtcm_1077"] == 2


@settings(max_examples=200)
@given(st.integers(1001, 1230), st.binary(max_size=120))
def test_no_message_makes_it_fail(number: int, rest: bytes) -> None:
    listen(framed((number << 4).to_bytes(2, "big") + rest))


def test_the_week_turns_over_within_a_stream() -> None:
    steps = [epoch((604_798.0 + second) % WEEK_S, week=WEEK + (second > 1)) for second in range(4)]
    found, counts = epochs_in(b"".join(rtcm_of(steps)), near_ns=unix_ns_from_gps(WEEK, 604_790.0))
    assert [(one.gps_week, one.tow_s) for one in found] == [
        (WEEK, 604_798.0),
        (WEEK, 604_799.0),
        (WEEK + 1, 0.0),
        (WEEK + 1, 1.0),
    ]
    for one, wanted in zip(found, steps, strict=True):
        assert_same_epoch(one, wanted, NAMES)
        assert not one.lock_lost.any() or one is found[0]
    assert counts["time_jumps_back"] == 0


@pytest.mark.parametrize("away_s", [-3.4 * 86_400, 3.4 * 86_400])
def test_the_week_is_found_from_half_a_week_away(away_s: float) -> None:
    found, _ = epochs_in(STREAM[0], near_ns=NEAR_NS + round(away_s * 1e9))
    # GLONASS names its weekday, too, so the whole epoch stays together.
    assert [(one.gps_week, one.tow_s, len(one.satellites)) for one in found] == [(WEEK, TOW_S, len(ROWS))]


def test_message_1013_sets_the_date_right() -> None:
    writer = BitWriter()
    for value, width in ((1013, 12), (0, 12), (60_083, 16), (23_604, 17), (0, 5), (18, 8)):
        writer.uint(value, width)
    found, _ = epochs_in(framed(writer.content()) + STREAM[0], near_ns=unix_ns_from_gps(100, 0.0))
    assert [(one.gps_week, len(one.satellites)) for one in found] == [(WEEK, len(ROWS))]
    # MJD 60083 is 2023-05-19; 18 leap seconds then.
    assert gps_ms_of_day(60_083, 23_604) == WEEK * WEEK_MS + (5 * 86_400 + 23_604 + 18) * 1000


def test_the_weekday_of_glonass_may_be_unknown() -> None:
    field = 7 << 27 | (6 * 3600 + 33 * 60 + 20 + 3 * 3600) * 1000
    assert epoch_gps_ms("R", field, gps_ms_from_unix_ns(NEAR_NS) - 3_600_000) == round((WEEK * WEEK_S + TOW_S) * 1000)


def glonass_field(unix_s: float) -> int:
    moscow_ms = round((unix_s + 3 * 3600) * 1000)
    return (moscow_ms // 86_400_000 + 4) % 7 << 27 | moscow_ms % 86_400_000


def test_a_leap_second_is_told_by_the_messages_around_it() -> None:
    # 2017-01-01: Unix second 1483228800 comes twice in GPS time.
    leap_unix_s = 1_483_228_800
    before = gps_ms_from_unix_ns((leap_unix_s - 1) * 10**9)
    for second in range(-3, 4):
        gps_ms = before + 1000 * (second + 1)
        # 23:59:60 and 0:00:00 read the same; the message of another constellation before it tells which.
        field = glonass_field(leap_unix_s + min(second, 0) + max(second - 1, 0))
        assert epoch_gps_ms("R", field, gps_ms) == gps_ms, second


def test_a_stream_over_a_leap_second_keeps_its_constellations_together() -> None:
    week, tow_s = gps_from_unix_ns(1_483_228_800 * 10**9)
    steps = [epoch(tow_s + second, week=week) for second in range(-3, 4)]
    # Rows are far from their sample's time, where the made-up range rate would lead out of the message.
    steps = [replace(one, pseudorange_m=EPOCHS[0].pseudorange_m) for one in steps]
    found, _ = epochs_in(b"".join(rtcm_of(steps)), near_ns=steps[0].t_ns)
    assert [len(one.satellites) for one in found] == [len(ROWS)] * len(steps)
    assert [one.tow_s - tow_s for one in found] == [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]


@given(st.integers(0, 2**40), st.sampled_from("GREJCS"))
def test_times_within_half_a_period_are_found(gps_ms: int, system: str) -> None:
    gps_ms += 1_200_000_000_000
    t_ns = unix_ns_from_gps_ms(gps_ms)
    writer = MsmWriter(0, 4)
    week, tow_ms = divmod(gps_ms, WEEK_MS)
    one = epoch(
        tow_ms / 1000.0,
        [(f"{system}{31 if system == 'S' else 1:02d}", "2I" if system == "C" else "1C", 2.2e7)],
        week=week,
    )
    one = replace(one, pseudorange_m=np.array([2.2e7]), carrier_phase_cycles=np.array([np.nan]), t_ns=t_ns)
    stream = RtcmStream(Counter(), t_ns + 3 * 86_400 * 10**9)
    (found,) = stream.add(writer.messages(one, {})[0])
    assert isinstance(found, Epoch)
    assert (found.gps_week, found.tow_s) == (week, tow_ms / 1000.0)
