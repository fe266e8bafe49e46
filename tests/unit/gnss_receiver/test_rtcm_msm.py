"""Multiple Signal Messages: what is written is read again, and pyrtcm reads the same."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
import pytest
from msgspec.structs import replace
from pyrtcm import RTCMMessage
from pyrtcm.rtcmtypes_core import RTCM_DATA_FIELDS

from services.gnss_receiver.bit_fields import BitWriter
from services.gnss_receiver.rtcm_messages import number_of
from services.gnss_receiver.rtcm_msm import MsmCells, msm_kind, read_msm
from services.gnss_receiver.rtcm_msm_layout import LOCKS, SIGNALS, lock_indicator, place_of, satellite_of
from services.gnss_receiver.rtcm_msm_writing import MsmWriter
from tests.unit.gnss_receiver.stream_samples import CHANNELS, ROWS, epoch

LIGHT_M_PER_MS = 299_792.458


def cells_of(messages: list[bytes]) -> list[MsmCells]:
    return [read_msm(message) for message in messages]


@pytest.mark.parametrize("kind", [4, 7])
def test_messages_hold_an_epoch(kind: Literal[4, 7]) -> None:
    wanted = epoch()
    messages = MsmWriter(77, kind).messages(wanted, CHANNELS)
    assert [number_of(one) for one in messages] == [family + kind for family in (1070, 1080, 1090, 1110, 1120, 1100)]
    cells = cells_of(messages)
    assert [one.more for one in cells] == [True] * 5 + [False]
    assert {one.station for one in cells} == {77}
    steps_m = {4: LIGHT_M_PER_MS * 2.0**-24, 7: LIGHT_M_PER_MS * 2.0**-29}
    for one in cells:
        for index, name in enumerate(zip(one.satellites, one.signals, strict=True)):
            row = list(zip(wanted.satellites, wanted.signals, strict=True)).index(name)
            assert one.pseudorange_m[index] == pytest.approx(wanted.pseudorange_m[row], abs=0.5 * steps_m[kind] + 1e-7)
            assert abs(one.phase_range_m[index] - one.pseudorange_m[index]) < 500.0
            assert one.cn0_dbhz[index] == wanted.cn0_dbhz[row]
            assert np.isnan(one.range_rate_mps[index]) == (kind == 4)


def test_pyrtcm_reads_what_is_written() -> None:
    wanted = epoch()
    message = next(one for one in MsmWriter(77).messages(wanted, CHANNELS) if number_of(one) == 1077)
    read = RTCMMessage(payload=message)
    assert (read.DF003, read.DF004, read.NSat, read.NSig, read.NCell) == (77, 455_618_000, 1, 2, 2)
    assert [read.CELLPRN_01, read.CELLSIG_01, read.CELLSIG_02] == ["003", "1C", "5Q"]
    rough_ms = read.DF397_01 + read.DF398_01
    assert (rough_ms + read.DF405_01) * LIGHT_M_PER_MS == pytest.approx(24_600_079.188, abs=3e-4)
    assert (rough_ms + read.DF405_02) * LIGHT_M_PER_MS == pytest.approx(24_599_974.875, abs=3e-4)
    assert read.DF408_01 == 30.0


@pytest.mark.parametrize("kind", [4, 5, 6, 7])
def test_every_kind_reads_as_pyrtcm_reads_it(kind: int) -> None:
    # MSM5 and MSM6 are not written by us; their bits are laid here.
    widths = {
        4: ((8, 10), (15, 22, 4, 1, 6)),
        5: ((8, 4, 10, 14), (15, 22, 4, 1, 6, 15)),
        6: ((8, 10), (20, 24, 10, 1, 10)),
        7: ((8, 4, 10, 14), (20, 24, 10, 1, 10, 15)),
    }[kind]
    writer = BitWriter()
    writer.uint(1070 + kind, 12)
    writer.uint(9, 12)
    writer.uint(1_000, 30)
    writer.uint(0, 19)
    writer.uint(1 << 63 | 1 << 40, 64)
    writer.uint(1 << 30 | 1 << 9, 32)
    writer.uint(0b1101, 4)
    numbers = iter(range(3, 1000, 7))
    for width in widths[0]:
        for _ in range(2):
            writer.uint(next(numbers) % (1 << (width - 1)), width)
    for width in widths[1]:
        for _ in range(3):
            writer.uint(next(numbers) % (1 << (width - 1)) if width > 1 else 1, width)
    message = writer.content()
    cells, read = read_msm(message), RTCMMessage(payload=message)
    assert cells.satellites == ("G01", "G01", "G24")
    assert cells.signals == ("1C", "5Q", "5Q")
    fine, phase, lock, cn0 = ("DF400", "DF401", "DF402", "DF403") if kind < 6 else ("DF405", "DF406", "DF407", "DF408")
    for at, satellite in enumerate((1, 1, 2)):
        rough = getattr(read, f"DF397_{satellite:02d}") + getattr(read, f"DF398_{satellite:02d}")
        assert cells.pseudorange_m[at] == pytest.approx(
            (rough + getattr(read, f"{fine}_{at + 1:02d}")) * LIGHT_M_PER_MS
        )
        assert cells.phase_range_m[at] == pytest.approx(
            (rough + getattr(read, f"{phase}_{at + 1:02d}")) * LIGHT_M_PER_MS
        )
        assert cells.cn0_dbhz[at] == getattr(read, f"{cn0}_{at + 1:02d}")
        assert cells.lock_s[at] == LOCKS[RTCM_DATA_FIELDS[lock][1]][0][getattr(read, f"{lock}_{at + 1:02d}")]
        assert cells.half_cycle[at] == 1
        if kind in (5, 7):
            rate = getattr(read, f"DF399_{satellite:02d}") + getattr(read, f"DF404_{at + 1:02d}")
            assert cells.range_rate_mps[at] == pytest.approx(rate)
        else:
            assert np.isnan(cells.range_rate_mps[at])


def test_what_is_missing_stays_missing() -> None:
    wanted = epoch(rows=[("G03", "1C", 2.2e7), ("G03", "5Q", 2.2e7), ("G04", "1C", 2.3e7)])
    hole = np.array([np.nan, 2.2e7, np.nan])
    none = np.full(3, np.nan)
    wanted = replace(wanted, pseudorange_m=hole, carrier_phase_cycles=none, doppler_hz=none, cn0_dbhz=none)
    (cells,) = cells_of(MsmWriter(0).messages(wanted, {}))
    # G04 has no pseudorange at all, hence no rough range to stand on.
    assert cells.satellites == ("G03", "G03")
    assert np.isnan(cells.pseudorange_m).tolist() == [True, False]
    for column in (cells.phase_range_m, cells.range_rate_mps, cells.cn0_dbhz):
        assert np.isnan(column).all()


def test_a_glonass_satellite_without_channel_goes_without_phase_and_rate() -> None:
    wanted = epoch(rows=[("R07", "1C", 2.2e7)])
    (known,) = cells_of(MsmWriter(0).messages(wanted, {"R07": -3}))
    (unknown,) = cells_of(MsmWriter(0).messages(wanted, {}))
    assert known.channels == {"R07": -3}
    assert np.isfinite(known.phase_range_m).all()
    assert unknown.channels == {}
    assert np.isnan(unknown.phase_range_m).all()
    assert np.isfinite(unknown.pseudorange_m).all()


def test_many_satellites_take_several_messages() -> None:
    rows = [
        (f"C{number:02d}", signal, 2.2e7 + number) for number in range(1, 31) for signal in ("2I", "6I", "7I", "1P")
    ]
    cells = cells_of(MsmWriter(0).messages(epoch(rows=rows), {}))
    assert [len(one.satellites) for one in cells] == [64, 56]
    assert [one.more for one in cells] == [True, False]
    assert sorted(name for one in cells for name in zip(one.satellites, one.signals, strict=True)) == sorted(
        row[:2] for row in rows
    )


def test_phases_keep_their_whole_cycles_until_lock_is_lost() -> None:
    writer = MsmWriter(0)
    steps = [epoch(455_618.0 + second, rows=ROWS[:1], rate_mps=700.0) for second in range(4)]
    lost = [replace(one, lock_lost=np.array([index == 3], np.uint8)) for index, one in enumerate(steps)]
    cells = [cells_of(writer.messages(one, {}))[0] for one in lost]
    metres = [one.phase_range_m[0] for one in cells]
    wave_m = LIGHT_M_PER_MS * 1000.0 / 1575.42e6
    carriers = [one.carrier_phase_cycles[0] * wave_m for one in lost]
    for (a, b), (c, d) in list(zip(pairwise(metres), pairwise(carriers), strict=True))[:2]:
        # Each phase is rounded to 2^-31 ms, 0.14 mm.
        assert b - a == pytest.approx(d - c, abs=3e-4)
    for one, locked_s in zip(cells, (0.0, 1.0, 2.0, 0.0), strict=True):
        assert one.lock_s[0] <= locked_s < one.lock_below_s[0]


@pytest.mark.parametrize("bits", [4, 10])
def test_lock_indicators_cover_all_times(bits: int) -> None:
    least, below = LOCKS[bits]
    last = {4: 15, 10: 704}[bits]
    assert least[0] == 0.0
    assert np.array_equal(least[1 : last + 1], below[:last])
    assert np.isinf(below[last])
    for indicator in range(last + 1):
        assert lock_indicator(float(least[indicator]), bits) == indicator
        assert indicator == 0 or lock_indicator(float(least[indicator]) - 1e-6, bits) == indicator - 1
    # RTCM 10403.3, tables 3.5-74 and 3.5-75: first and last row of several ranges, in milliseconds.
    table = {
        4: {1: 32, 14: 262_144, 15: 524_288},
        10: {63: 63, 64: 64, 96: 128, 128: 256, 320: 16_384, 704: 67_108_864},
    }
    for indicator, milliseconds in table[bits].items():
        assert least[indicator] == milliseconds / 1000.0


def test_places_of_satellites() -> None:
    assert [satellite_of("S", 1), satellite_of("S", 39), satellite_of("S", 40)] == ["S20", "S58", None]
    assert [satellite_of("J", 7), satellite_of("J", 11), satellite_of("G", 33)] == ["J07", None, None]
    assert place_of("S31") == 12
    for system in SIGNALS:
        assert satellite_of(system, 1) is not None


def test_kinds() -> None:
    assert [msm_kind(number) for number in (1073, 1074, 1077, 1078, 1104, 1137, 1019, 4076)] == [0, 4, 7, 0, 4, 7, 0, 0]


def test_messages_cut_short_are_refused() -> None:
    (message,) = MsmWriter(0).messages(epoch(rows=ROWS[:2]), {})
    for length in range(2, len(message)):
        with pytest.raises(ValueError, match="bits"):
            read_msm(message[:length])


def test_too_many_cells_are_refused() -> None:
    message = bytearray(40)
    message[0:2] = (1077 << 4).to_bytes(2, "big")
    message[9:22] = b"\xff" * 13
    with pytest.raises(ValueError, match=r"more than 64 cells"):
        read_msm(bytes(message))


def test_a_message_without_satellites_has_no_cells() -> None:
    message = (1077 << 4).to_bytes(2, "big") + bytes(20)
    assert read_msm(message).satellites == ()


def test_pseudoranges_that_no_message_holds_are_refused() -> None:
    with pytest.raises(ValueError, match=r"a pseudorange of 90000000\.0 m to G03 does not fit"):
        MsmWriter(0).messages(epoch(rows=[("G03", "1C", 9e7)]), {})
