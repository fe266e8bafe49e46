"""A recording as what its receiver said, with what the satellites broadcast at its right places."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec.structs import replace

from schemas.gnss import Epoch, Ionosphere
from schemas.gnss_time import WEEK_S
from services.gnss_receiver.broadcast_choice import BroadcastChoice
from services.gnss_receiver.heard import Heard
from services.gnss_receiver.observations import Navigation, Observations


class BroadcastBeside:
    """Gives, before each epoch, the ephemerides of a navigation file that have become the nearest ones."""

    def __init__(self, navigation: Navigation) -> None:
        """Have given nothing yet."""
        self._choice = BroadcastChoice.of(navigation.ephemerides)
        self._ionosphere: Ionosphere | None = navigation.ionosphere

    def before(self, heard: Heard) -> Iterator[Heard]:
        """What is to be said before `heard`; the ionosphere bears the time of the first epoch."""
        if not isinstance(heard, Epoch):
            return
        if self._ionosphere is not None:
            yield replace(self._ionosphere, t_ns=heard.t_ns)
            self._ionosphere = None
        yield from self._choice.changed(heard.gps_week * WEEK_S + heard.tow_s)


def with_broadcast(recorded: Iterable[Heard], navigation: Navigation) -> Iterator[Heard]:
    """What was recorded, joined with what a navigation file holds."""
    beside = BroadcastBeside(navigation)
    for heard in recorded:
        yield from beside.before(heard)
        yield heard


def epochs_of(observations: Observations) -> Iterator[Epoch]:
    """Epochs of a recording, one after the other."""
    for index in range(len(observations)):
        yield observations.epoch(index)
