"""Which demodulator a profile needs, and what its receivers are called."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.track_circuit.profile import Profile
from services.track_circuit.qam_demodulation import QamDemodulator
from services.track_circuit.receiver import Demodulation, StoredTaps
from services.track_circuit.receiver_demodulation import Demodulator


class StreamDemodulator(Protocol):
    """Bits out of contiguous samples that arrive in pieces."""

    def take(self, samples: NDArray[np.float64]) -> Demodulation:
        """Bits that these samples complete."""
        ...

    def finish(self) -> Demodulation:
        """What is left at the end of the samples."""
        ...


def receiver_used(profile: Profile, receiver: str) -> str:
    """The receiver by which a profile is received where `receiver` is set.

    CDMA-QAM has no sequence to be estimated: it is equalised without feedback (`least-squares`), or else with (`dfe`).
    """
    return receiver if profile.scheme != "cdma-qam" or receiver == "least-squares" else "dfe"


def demodulator_for(
    sample_rate_hz: float, profile: Profile, receiver: str, stored: StoredTaps | None = None
) -> StreamDemodulator:
    """A demodulator ready for the first sample; raises as these do."""
    if profile.scheme == "cdma-qam":
        return QamDemodulator(sample_rate_hz, profile, receiver_used(profile, receiver), stored)
    return Demodulator(sample_rate_hz, profile, receiver, stored)
