"""All receivers by name."""

from __future__ import annotations

from typing import Final

from services.track_circuit.dfe import DfeReceiver
from services.track_circuit.equaliser import LinearReceiver
from services.track_circuit.mlse import MlseReceiver
from services.track_circuit.profile import Profile
from services.track_circuit.receiver import Receiver, StoredTaps

RECEIVERS: Final = ("mlse", "dfe", "least-squares", "rls", "nlms", "lms")
"""The default first; `lms` is the paper's."""


def receiver_named(name: str, profile: Profile, stored: StoredTaps | None = None) -> Receiver:
    """The receiver, ready to begin.

    Raises ValueError for an unknown name and for coefficients of another receiver, ReceiverRefusedError when it
    cannot work with the profile.
    """
    if stored is not None and stored.receiver != name:
        msg = f"stored coefficients of receiver {stored.receiver!r} do not fit {name!r}"
        raise ValueError(msg)
    match name:
        case "mlse":
            return MlseReceiver(profile, stored)
        case "dfe":
            return DfeReceiver(profile, stored)
        case "least-squares" | "rls" | "nlms" | "lms":
            return LinearReceiver(profile, name, stored)
        case _:
            msg = f"receiver {name!r}: there are {', '.join(RECEIVERS)}"
            raise ValueError(msg)
