"""Two receivers of one train through the service: front end and agreement."""

from __future__ import annotations

import pytest

from schemas.codec import decode
from schemas.gnss import FrontEnd
from schemas.topics import GNSS_FRONT_END, topic_of
from services.gnss_correction.front_end import Antenna
from services.gnss_correction.service import SERVICE
from services.gnss_correction.settings import Config
from services.recorder.offline_replay import replay_through
from tests.replay.test_gnss_correction import broadcast, drive, epoch_sample


def heard_of(rear_behind_m: float) -> list[FrontEnd]:
    """What is said of two antennas that receive the same, and so stand at the same place."""
    epochs = drive()
    mixed = [*broadcast("front", t_ns=epochs[0].t_ns - 1), *broadcast("rear", t_ns=epochs[0].t_ns - 1)]
    for epoch in epochs:
        mixed += [epoch_sample(epoch, "front"), epoch_sample(epoch, "rear")]
    antennas = {"front": Antenna(behind_front_m=0.0), "rear": Antenna(behind_front_m=rear_behind_m)}
    config = Config(method="robust", compare=(), antennas=antennas)
    heard = replay_through(mixed, [SERVICE], {"gnss_correction": config})
    found = [(topic_of(sample.key), sample) for sample in heard]
    return [decode(FrontEnd, one.payload) for address, one in found if address and address.topic is GNSS_FRONT_END]


@pytest.mark.parametrize(("rear_behind_m", "agreement"), [(0.0, "agree"), (400.0, "disagree")])
def test_antennas_are_held_against_the_train(rear_behind_m: float, agreement: str) -> None:
    said = heard_of(rear_behind_m)
    assert said
    assert said[-1].agreement == agreement
    assert said[-1].devices == ("front", "rear")
    assert said[-1].chainage_m is None, "there is no line"
