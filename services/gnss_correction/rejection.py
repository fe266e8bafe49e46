"""Why a satellite or an epoch did not take part, as numbers for kernels and in words for people."""

from __future__ import annotations

from enum import IntEnum


class Rejection(IntEnum):
    """State of one satellite at one epoch; USABLE is 0, the others say why it was left out."""

    USABLE = 0
    NO_PSEUDORANGE = 1
    ABSURD_PSEUDORANGE = 2
    NO_EPHEMERIS = 3
    STALE_EPHEMERIS = 4
    UNHEALTHY = 5
    NO_ORBIT = 6
    WEAK_SIGNAL = 7
    BELOW_MASK = 8
    ALONE_IN_SYSTEM = 9
    MULTIPATH = 10
    EPOCH_REFUSED = 11
    NO_SIGNAL = 12
    CONTRADICTS = 13
    INCONSISTENT = 14
    UNCORRECTED = 15


class Outcome(IntEnum):
    """How solving an epoch ended."""

    FIX = 0
    TOO_FEW_SATELLITES = 1
    WEAK_GEOMETRY = 2
    NOT_CONVERGED = 3
    ABSURD_PLACE = 4
    CONTRADICTION = 5
    PREDICTED = 6
    OFF_LINE = 7


REJECTION_WORDS = {
    Rejection.USABLE: "usable",
    Rejection.NO_PSEUDORANGE: "no pseudorange",
    Rejection.ABSURD_PSEUDORANGE: "absurd pseudorange",
    Rejection.NO_EPHEMERIS: "no ephemeris",
    Rejection.STALE_EPHEMERIS: "ephemeris stale",
    Rejection.UNHEALTHY: "unhealthy",
    Rejection.NO_ORBIT: "ephemeris gives no orbit",
    Rejection.WEAK_SIGNAL: "signal too weak",
    Rejection.BELOW_MASK: "below the elevation mask",
    Rejection.ALONE_IN_SYSTEM: "alone in its system",
    Rejection.MULTIPATH: "multipath",
    Rejection.EPOCH_REFUSED: "epoch refused",
    Rejection.NO_SIGNAL: "no L1, E1 or B1I signal",
    Rejection.CONTRADICTS: "contradicts the other satellites by kilometres",
    Rejection.INCONSISTENT: "disagrees with the filter",
    Rejection.UNCORRECTED: "without a correction where enough others have one",
}

OUTCOME_WORDS = {
    Outcome.FIX: "fix",
    Outcome.TOO_FEW_SATELLITES: "too few satellites",
    Outcome.WEAK_GEOMETRY: "weak geometry",
    Outcome.NOT_CONVERGED: "no convergence",
    Outcome.ABSURD_PLACE: "absurd place",
    Outcome.CONTRADICTION: "contradicting pseudoranges",
    Outcome.PREDICTED: "predicted",
    Outcome.OFF_LINE: "not on the line",
}
