"""All receivers by name."""

from __future__ import annotations

from services.track_circuit.mlse import MlseReceiver
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Receiver, StoredTaps

RECEIVERS = ("mlse",)


def receiver_named(name: str, profile: Profile, stored: StoredTaps | None = None) -> Receiver:
    """The receiver, ready to begin.

    Raises ValueError for an unknown name, ReceiverRefusedError when it cannot work with the profile.
    """
    if name not in RECEIVERS:
        msg = f"receiver {name!r}: there are {', '.join(RECEIVERS)}"
        raise ValueError(msg)
    return MlseReceiver(profile, stored)
