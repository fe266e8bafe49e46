"""A train's radio device: what it says of a signal that comes in, with its own errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.line import RadioSite
from services.simulator.radio_draws import complex_normals, normals, stream, uniforms
from services.simulator.radio_link import FrameCode
from services.simulator.radio_propagation import LIGHT_MPS
from services.simulator.radio_settings import RadioSettings

Floats = NDArray[np.float64]

CUT_PPM_PER_C: Final = 0.01
"""An AT-cut crystal near room temperature."""
ROOM_C: Final = 25.0
TX_DB_PER_C: Final = -0.01
"""Of a power amplifier as it gets warmer."""
TX_READING_DB: Final = 0.1
OFFSET_READING_HZ: Final = 15.0
TEMPERATURE_STEP_C: Final = 0.5


class Moving(Protocol):
    """Where the device is at the ends of its periods."""

    @property
    def number(self) -> int:
        """Of the pass."""

    @property
    def rises(self) -> bool:
        """Whether axis_m rises."""

    @property
    def t_s(self) -> Floats:
        """Unix time, shape (n,)."""

    @property
    def axis_m(self) -> Floats:
        """Shape (n,)."""

    @property
    def speed_mps(self) -> Floats:
        """Shape (n,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Incoming:
    """What comes in from one radio on one channel; columns of shape (n,)."""

    site: RadioSite
    channel: str
    signal_mw: Floats
    """Before fast fading."""
    other_mw: Floats
    """Noise and interference."""
    noise_mw: float
    """Noise alone, as the device knows it."""
    ambient_c: Floats
    weaker_db: Floats
    """By which the sender has become weaker."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """What the device says, a row for each measuring period; NaN where it says nothing."""

    rows: NDArray[np.intp]
    """Rows of the journey."""
    channel_power_dbm: Floats
    decoded_power_dbm: Floats
    received_ratio: Floats
    corrected_bits: Floats
    snr_db: Floats
    frequency_offset_hz: Floats
    temperature_c: Floats
    tx_power_dbm: Floats
    """Of the sender, told in its frames."""


def read_power(
    incoming: Incoming, moving: Moving, rows: NDArray[np.intp], settings: RadioSettings, code: FrameCode
) -> Reading:
    """Readings of one radio; the same rows of the same pass give the same readings, however they are cut."""
    names = (settings.seed, incoming.site.id, incoming.channel, moving.number)
    period = np.rint(moving.t_s / settings.period_s).astype(np.int64)
    signal_mw = incoming.signal_mw[:, None] * _fading(stream(*names, "fading"), moving, settings)
    other_mw = incoming.other_mw[:, None]
    sinr_db = 10.0 * np.log10(np.maximum(signal_mw / other_mw, 1e-12))
    frame = period[:, None] * settings.frames + np.arange(settings.frames)
    decoded = uniforms(stream(*names, "frames"), frame) < code.received_at(sinr_db)
    count = decoded.sum(1)
    heard = count > 0
    shown = signal_mw / other_mw * incoming.noise_mw
    if settings.decoded_power == "total":
        shown = signal_mw + other_mw
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_mw = np.where(decoded, shown, 0.0).sum(1) / count
        ratio = np.where(decoded, signal_mw / other_mw, 0.0).sum(1) / count
        corrected = np.where(decoded, code.corrected_at(sinr_db), 0.0).sum(1) / count
        decoded_dbm, snr_db = 10.0 * np.log10(mean_mw), 10.0 * np.log10(ratio)
    scatter = normals(stream(*names, "corrected"), period)
    corrected = np.maximum(corrected + scatter * np.sqrt(corrected / np.maximum(count, 1)), 0.0)
    error = normals(stream(*names, "reading"), period) * settings.reading_db
    temperature = incoming.ambient_c + settings.self_heating_c
    return Reading(
        rows=rows,
        channel_power_dbm=_channel_power_dbm(signal_mw.mean(1), incoming, names, period, settings) + error,
        decoded_power_dbm=np.where(heard, decoded_dbm + error, np.nan),
        received_ratio=count / settings.frames,
        corrected_bits=np.where(heard, corrected, np.nan),
        snr_db=np.where(heard, snr_db + error, np.nan),
        frequency_offset_hz=np.where(heard, _offset_hz(incoming, moving, names, period, settings), np.nan),
        temperature_c=np.rint(temperature / TEMPERATURE_STEP_C) * TEMPERATURE_STEP_C,
        tx_power_dbm=np.where(heard, _tx_dbm(incoming, names, period, settings), np.nan),
    )


def _fading(of: int, moving: Moving, settings: RadioSettings) -> Floats:
    """Power of the fast fading in every frame, mean 1 (Rice); a new one every half wavelength of way."""
    shape = (len(moving.t_s), settings.frames)
    if settings.fading == "none":
        return np.ones(shape)
    back_s = settings.period_s * (np.arange(settings.frames) - settings.frames + 1) / settings.frames
    way_m = moving.axis_m[:, None] + (1.0 if moving.rises else -1.0) * moving.speed_mps[:, None] * back_s
    half_m = LIGHT_MPS / settings.frequency_hz / 2.0
    scattered = complex_normals(of, np.rint(way_m / half_m).astype(np.int64))
    steady = 10.0 ** (settings.rician_k_db / 10.0)
    return np.asarray(np.abs(np.sqrt(steady) + scattered) ** 2 / (steady + 1.0))


def _channel_power_dbm(
    signal_mw: Floats, incoming: Incoming, names: tuple[int | str, ...], period: NDArray[np.int64],
    settings: RadioSettings,
) -> Floats:  # fmt: skip
    """Mean power of signal and white noise over so many samples, which scatters by √(N² + 2 S N) / √samples."""
    other_mw = incoming.other_mw
    spread = np.sqrt((other_mw**2 + 2.0 * signal_mw * other_mw) / settings.samples)
    power = signal_mw + other_mw + spread * normals(stream(*names, "samples"), period)
    return np.asarray(10.0 * np.log10(np.maximum(power, 1e-3 * incoming.noise_mw)))


def _offset_hz(
    incoming: Incoming, moving: Moving, names: tuple[int | str, ...], period: NDArray[np.int64], settings: RadioSettings
) -> Floats:
    """Difference of both oscillators, each with its temperature, and the Doppler shift."""
    seed, radio = settings.seed, incoming.site.id
    ppm = settings.crystal_ppm * (normals(stream(seed, radio, "crystal"), np.zeros(1, np.int64))[0]
                                  - normals(stream(seed, "crystal"), np.zeros(1, np.int64))[0])  # fmt: skip
    # The cabinet at the site feels the weather less than the train's device, which heats itself.
    warmer_c = 0.5 * (incoming.ambient_c - ROOM_C) + settings.self_heating_c
    closing = np.sign(incoming.site.axis_m - moving.axis_m) * (1.0 if moving.rises else -1.0)
    doppler = settings.frequency_hz * closing * moving.speed_mps / LIGHT_MPS
    reading = OFFSET_READING_HZ * normals(stream(*names, "offset"), period)
    return np.asarray(settings.frequency_hz * 1e-6 * (ppm - CUT_PPM_PER_C * warmer_c) + doppler + reading)


def _tx_dbm(
    incoming: Incoming, names: tuple[int | str, ...], period: NDArray[np.int64], settings: RadioSettings
) -> Floats:
    """What the sender's own meter shows: its amplifier gives less when it is warm, and as it ages."""
    reading = TX_READING_DB * normals(stream(*names, "tx"), period)
    warmer_c = incoming.ambient_c + settings.self_heating_c - ROOM_C
    return np.asarray(settings.tx_power_dbm - incoming.weaker_db + TX_DB_PER_C * warmer_c + reading)
