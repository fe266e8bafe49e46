"""Streams of receivers, made message by message."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from schemas.gnss import Epoch
from schemas.gnss_time import unix_ns_from_gps
from services.gnss_receiver.carrier_frequency import signal_hz
from services.gnss_receiver.heard import Heard
from services.gnss_receiver.receiver_stream import ReceiverStream
from services.gnss_receiver.rtcm_messages import framed
from services.gnss_receiver.rtcm_msm_writing import MsmWriter
from services.gnss_receiver.stream_frames import nmea_checksum, ubx_checksum

WEEK, TOW_S = 2262, 455_618.0
NEAR_NS = unix_ns_from_gps(WEEK, TOW_S)
ROWS = (
    ("G03", "1C", 24_600_079.188),
    ("G03", "5Q", 24_599_974.875),
    ("R07", "1C", 21_150_376.213),
    ("E07", "1C", 25_533_795.813),
    ("J02", "1C", 37_000_123.5),
    ("C30", "2I", 22_516_779.605),
    ("S31", "1C", 37_155_256.97),
)
CHANNELS = {"R07": 5}


def epoch(
    tow_s: float = TOW_S,
    rows: Iterable[tuple[str, str, float]] = ROWS,
    *,
    week: int = WEEK,
    lost: Sequence[int] | None = None,
    rate_mps: float = 100.0,
) -> Epoch:
    """Epoch whose pseudoranges grow by `rate_mps`; carrier and Doppler go with them."""
    satellites, signals, ranges = zip(*rows, strict=True)
    passed_s = (week - WEEK) * 604_800 + tow_s - TOW_S
    range_m = np.array(ranges) + rate_mps * passed_s
    hz = [signal_hz(name[0], signal, CHANNELS.get(name, 0)) for name, signal in zip(satellites, signals, strict=True)]
    wave_m = 299_792_458.0 / np.array(hz, np.float64)
    return Epoch(
        t_ns=unix_ns_from_gps(week, tow_s),
        gps_week=week,
        tow_s=tow_s,
        satellites=satellites,
        signals=signals,
        pseudorange_m=range_m,
        carrier_phase_cycles=range_m / wave_m + 17.0,
        doppler_hz=-rate_mps / wave_m,
        cn0_dbhz=np.linspace(30.0, 48.0, len(ranges)).round(),
        lock_lost=np.array(lost if lost is not None else [0] * len(ranges), np.uint8),
    )


def rtcm_of(epochs: Iterable[Epoch], kind: Literal[4, 7] = 7, station: int = 5) -> list[bytes]:
    """Frames of epochs, one bytes object for each epoch."""
    writer = MsmWriter(station, kind)
    return [b"".join(framed(message) for message in writer.messages(one, CHANNELS)) for one in epochs]


def ubx(kind: bytes, message: bytes) -> bytes:
    """UBX frame of class and identity `kind`."""
    content = kind + len(message).to_bytes(2, "little") + message
    return b"\xb5\x62" + content + ubx_checksum(content)


Row = tuple[int, int, int, float, float, float, int, int, int]
"""System, satellite, signal, pseudorange, phase, Doppler, lock [ms], C/N0, tracking bits."""


def rawx(rows: Sequence[Row], tow_s: float = TOW_S, week: int = WEEK, status: int = 1) -> bytes:
    """RXM-RAWX."""
    head = struct.pack("<dHbBBB2x", tow_s, week, 18, len(rows), status, 1)
    return ubx(b"\x02\x15", head + b"".join(_raw(*row) for row in rows))


def _raw(
    system: int,
    satellite: int,
    signal: int,
    range_m: float,
    cycles: float,
    doppler_hz: float,
    lock_ms: int,
    cn0: int,
    tracking: int,
) -> bytes:
    return struct.pack(
        "<ddfBBBBHBBBBBx", range_m, cycles, doppler_hz, system, satellite, signal, 7, lock_ms, cn0, 4, 3, 2, tracking
    )


def sfrbx(system: int, satellite: int, signal: int, words: Sequence[int], channel: int = 7) -> bytes:
    """RXM-SFRBX."""
    head = struct.pack("<BBBBBBBB", system, satellite, signal, channel, len(words), 1, 2, 0)
    return ubx(b"\x02\x13", head + b"".join(word.to_bytes(4, "little") for word in words))


def pvt(fix_type: int = 3, flags: int = 0x83, lat_deg: float = 31.18, valid: int = 7, second: int = 20) -> bytes:
    """NAV-PVT of 2023-05-19 06:33:20 UTC less 1 ms."""
    head = struct.pack(
        "<IHBBBBBBIiBBBB", 455_618_000, 2023, 5, 19, 6, 33, second, valid, 30, -1_000_000, fix_type, flags, 0, 12
    )
    place = struct.pack("<iiiiII", round(121.4 * 1e7), round(lat_deg * 1e7), 25_000, 14_000, 1_200, 2_500)
    speed = struct.pack("<iiiiiIIH", 3_000, -4_000, 500, 5_000, 0, 100, 1_000, 150)
    return ubx(b"\x01\x07", head + place + speed + struct.pack("<H4xihH", 0x0A, 0, 0, 0))


def nmea(body: str) -> bytes:
    """NMEA sentence of a body."""
    return f"${body}*{nmea_checksum(body.encode('ascii')):02X}\r\n".encode("ascii")


def gga(clock: str = "063320.00", quality: int = 1) -> bytes:
    return nmea(f"GNGGA,{clock},3110.80000,N,12124.00000,E,{quality},12,0.8,20.0,M,10.5,M,1.5,0001")


def rmc(clock: str = "063320.00", day: str = "190523", status: str = "A", mode: str = "D") -> bytes:
    return nmea(f"GNRMC,{clock},{status},3110.80000,N,12124.00000,E,10.0,90.0,{day},,,{mode},V")


def gst(clock: str = "063320.00") -> bytes:
    return nmea(f"GNGST,{clock},5.0,,,,3.0,4.0,6.0")


def listen(stream: bytes, chunk: int = 100_000, near_ns: int = NEAR_NS) -> tuple[list[Heard], ReceiverStream]:
    """Everything in a stream, given in chunks."""
    receiver = ReceiverStream(near_ns)
    heard: list[Heard] = []
    for at in range(0, len(stream), chunk):
        heard += receiver.feed(stream[at : at + chunk])
    return heard, receiver


def assert_same_epoch(ours: Epoch, wanted: Epoch, rows: Iterable[str], *, rate: bool = True) -> None:
    """Equal to the resolution of MSM7; `rows` names the satellites that must be there."""
    assert (ours.gps_week, ours.tow_s, ours.t_ns) == (wanted.gps_week, wanted.tow_s, wanted.t_ns)
    index = {name: at for at, name in enumerate(zip(wanted.satellites, wanted.signals, strict=True))}
    assert sorted(ours.satellites) == sorted(rows)
    places = [index[name] for name in zip(ours.satellites, ours.signals, strict=True)]
    # Half a step of 2^-29 ms is 0.3 mm, of 2^-4 dB-Hz 0.03, of 0.1 mm/s 0.0003 Hz.
    assert np.allclose(ours.pseudorange_m, wanted.pseudorange_m[places], rtol=0, atol=0.0003)
    assert np.allclose(ours.cn0_dbhz, wanted.cn0_dbhz[places], rtol=0, atol=0.032)
    if rate:
        assert np.allclose(ours.doppler_hz, wanted.doppler_hz[places], rtol=0, atol=0.0004)
