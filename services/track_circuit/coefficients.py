"""Stored coefficients: which set fits a circuit and a place, and how sets come and go."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from schemas.track_circuit import CoefficientStore, StoredCoefficients
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Demodulation, StoredTaps

WORST_EVM_DB = -6.0
"""A trial run with more error than this teaches nothing: about one decision in fifty was wrong."""
FEWEST_SYMBOLS = 128
DRIFT_LIMIT = 0.5
"""Taps that moved further from the stored ones, relative to their size, belong to another circuit or a defect."""
GAINED = {"dfe": 16}
"""Taps that take part in the signal's gain and phase, where not all of a receiver do: feedback taps see decisions."""
BIN_M = 100.0
"""Length of the stretches in which the response of a circuit is taken for one and the same, on board."""


class TrainingError(ValueError):
    """A trial run from which nothing can be learned; the message says why."""


def profile_digest(profile: Profile) -> str:
    """Digest of everything in a profile that coefficients depend on; pilot bits and framing are not part of it."""
    relevant = (
        profile.scheme,
        profile.carrier_hz,
        profile.chip_rate_hz,
        profile.code_length,
        profile.ch1_row,
        profile.ch2_row,
        profile.ch2_amplitude,
        profile.pulse,
        profile.roll_off if profile.pulse != "rectangular" else None,
        profile.qam_order if profile.scheme == "cdma-qam" else None,
    )
    return hashlib.sha256(msgspec.json.encode(relevant)).hexdigest()[:16]


def distance_bin(distance_m: float) -> tuple[float, float]:
    """Stretch of a circuit in which a distance from its sending end lies.

    >>> distance_bin(250.0)
    (200.0, 300.0)
    """
    begin = float(np.floor(distance_m / BIN_M)) * BIN_M
    return begin, begin + BIN_M


@dataclass(frozen=True, slots=True)
class Choice:
    """A set, or why there is none."""

    chosen: StoredCoefficients | None
    reason: str = ""


def choose(
    store: CoefficientStore, circuit: str, profile: Profile, receiver: str, distance_m: float | None = None
) -> Choice:
    """The set of a circuit for a receiver; on board the one of the train's stretch, else that of the whole circuit.

    Sets learned with another profile or for another receiver are refused, with the reason.
    """
    own = [one for one in store.sets if one.circuit == circuit]
    if not own:
        return Choice(None, f"no coefficients are stored for circuit {circuit}")
    digest = profile_digest(profile)
    fitting = [one for one in own if one.profile_digest == digest]
    if not fitting:
        return Choice(None, f"the coefficients of circuit {circuit} were learned with another profile")
    fitting = [one for one in fitting if one.receiver == receiver]
    if not fitting:
        others = ", ".join(sorted({one.receiver for one in own}))
        return Choice(None, f"the coefficients of circuit {circuit} belong to receiver {others}, not to {receiver}")
    if distance_m is not None:
        here = [one for one in fitting if one.distance_bin_m and _within(distance_m, one.distance_bin_m)]
        if here:
            return Choice(max(here, key=lambda one: one.version))
    whole = [one for one in fitting if one.distance_bin_m is None]
    if not whole:
        return Choice(None, f"no coefficients of circuit {circuit} for this stretch")
    return Choice(max(whole, key=lambda one: one.version))


def _within(distance_m: float, stretch: tuple[float, float]) -> bool:
    return stretch[0] <= distance_m < stretch[1]


def learned(
    found: Demodulation,
    profile: Profile,
    circuit: str,
    day: str,
    weather: str = "",
    distance_bin_m: tuple[float, float] | None = None,
) -> StoredCoefficients:
    """Coefficients out of a trial run. Raises TrainingError for one that was too short or too poor."""
    if found.refused or not len(found.bit):
        raise TrainingError(found.refused or "nothing was received")
    if len(found.bit) < FEWEST_SYMBOLS:
        msg = f"{len(found.bit)} symbols are too few to learn from ({FEWEST_SYMBOLS} are needed)"
        raise TrainingError(msg)
    evm_db = float(np.median(found.evm_db))
    if evm_db > WORST_EVM_DB:
        msg = f"the error vector magnitude, {evm_db:.1f} dB, is above {WORST_EVM_DB:g} dB: nothing can be learned"
        raise TrainingError(msg)
    return coefficients_of(
        profile,
        circuit,
        found.receiver,
        found.taps,
        trained=day,
        level_db=float(np.median(found.level_db)),
        evm_db=evm_db,
        symbols=len(found.bit),
        weather=weather,
        distance_bin_m=distance_bin_m,
    )


def coefficients_of(
    profile: Profile,
    circuit: str,
    receiver: str,
    taps: NDArray[np.complex128],
    *,
    trained: str,
    level_db: float,
    evm_db: float,
    symbols: int,
    weather: str = "",
    distance_bin_m: tuple[float, float] | None = None,
) -> StoredCoefficients:
    """A receiver's taps as they are kept."""
    return StoredCoefficients(
        circuit=circuit,
        distance_bin_m=distance_bin_m,
        receiver=receiver,
        profile_digest=profile_digest(profile),
        trained=trained,
        weather=weather,
        taps=tuple((float(tap.real), float(tap.imag)) for tap in taps.ravel()),
        level_db=level_db,
        mse=float(10.0 ** (evm_db / 10.0)),
        symbols=symbols,
    )


def with_set(
    store: CoefficientStore, new: StoredCoefficients, *, trained: bool = True
) -> tuple[CoefficientStore, StoredCoefficients]:
    """The store with a set in the place of the one before; its version counts up where it was `trained` anew."""

    def same(one: StoredCoefficients) -> bool:
        return (one.circuit, one.distance_bin_m, one.receiver) == (new.circuit, new.distance_bin_m, new.receiver)

    before = max((one.version for one in store.sets if same(one)), default=0)
    numbered = msgspec.structs.replace(new, version=before + 1 if trained else max(before, 1))
    others = tuple(one for one in store.sets if not same(one))
    order = sorted((*others, numbered), key=lambda one: (one.circuit, one.receiver, one.distance_bin_m or (-1.0, 0.0)))
    return CoefficientStore(sets=tuple(order)), numbered


def taps_of(stored: StoredCoefficients) -> StoredTaps:
    """A stored set as receivers begin with it."""
    taps = np.array([complex(*pair) for pair in stored.taps], np.complex128)
    return StoredTaps(receiver=stored.receiver, taps=taps, mse=stored.mse, symbols=stored.symbols)


def drift(taps: NDArray[np.complex128], stored: StoredCoefficients) -> float | None:
    """Distance of taps from the stored ones after the best common gain and phase, relative to their size, 0 … 1.

    Level and carrier phase are others every day and say nothing of the circuit. None when they cannot be compared.
    """
    wanted, found = taps_of(stored).taps, np.asarray(taps, np.complex128).ravel()
    if len(found) != len(wanted):
        return None
    gained = slice(GAINED.get(stored.receiver))
    sizes = float(np.linalg.norm(found[gained]) * np.linalg.norm(wanted[gained]))
    if not sizes > 0.0:
        return None
    likeness = abs(complex(np.vdot(found[gained], wanted[gained]))) / sizes
    return float(np.sqrt(max(0.0, 1.0 - min(likeness, 1.0) ** 2)))


STEP = 0.02
"""Share by which stored taps go towards new ones at a time."""


def adapted(
    stored: StoredCoefficients, trained: StoredCoefficients, taps: NDArray[np.complex128]
) -> StoredCoefficients:
    """`stored` moved gently towards `taps`, never further than DRIFT_LIMIT from what the trial run `trained` gave.

    Phase and gain of the day are taken off first. Taps that cannot be compared, or are no neighbours, teach nothing.
    """
    before, anchor = taps_of(stored).taps, taps_of(trained).taps
    found = np.asarray(taps, np.complex128).ravel()
    off = drift(found, trained)
    if off is None or off > DRIFT_LIMIT or not np.isfinite(found).all():
        return stored
    gained = slice(GAINED.get(stored.receiver))
    level = found.copy()
    level[gained] *= np.vdot(found[gained], before[gained]) / np.vdot(found[gained], found[gained])
    moved = before + STEP * (level - before)
    distance, limit = moved - anchor, DRIFT_LIMIT * float(np.linalg.norm(anchor))
    size = float(np.linalg.norm(distance))
    if size > limit:
        moved = anchor + distance * (limit / size)
    return msgspec.structs.replace(stored, taps=tuple((float(tap.real), float(tap.imag)) for tap in moved))
