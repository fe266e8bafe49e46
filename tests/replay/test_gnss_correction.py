"""The correction as a service: on a virtual bus and clock, and from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest

from schemas.codec import decode, encode
from schemas.gnss import Epoch, Fix, Ionosphere, Verdicts
from schemas.thresholds import Band, Thresholds
from schemas.topic import Place
from schemas.topics import (
    GNSS_COMPARISON,
    GNSS_EPHEMERIS,
    GNSS_EPOCH,
    GNSS_FIX,
    GNSS_IONOSPHERE,
    GNSS_VERDICT,
    topic_of,
)
from services.gnss_correction.service import MOST_DEVICES, SERVICE
from services.gnss_correction.settings import Config
from services.gnss_correction.thresholds_file import write_thresholds
from services.numerics.geodesy import enu_about
from services.recorder.offline_replay import Part, ReplayError, replay, replay_through
from services.runtime.manual_loop import manual_loop
from services.runtime.node import Sample
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, constellation, measured

TRAIN = Place("demo", "train", "T1")
GPS = constellation()


def epoch_sample(epoch: Epoch, device: str = "front") -> Sample:
    return Sample(GNSS_EPOCH.at(TRAIN, device=device), encode(epoch), b"", epoch.t_ns)


def broadcast(device: str = "front", *, t_ns: int) -> list[Sample]:
    """Everything that the satellites say, as a receiver publishes it."""
    ionosphere = Ionosphere(t_ns=t_ns, alpha=(0.0,) * 4, beta=(0.0,) * 4)
    return [
        *(
            Sample(GNSS_EPHEMERIS.at(TRAIN, device=device, satellite=one.satellite), encode(one), b"", t_ns)
            for one in GPS
        ),
        Sample(GNSS_IONOSPHERE.at(TRAIN, device=device), encode(ionosphere), b"", t_ns),
    ]


def drive(count: int = 16, reflected_from: int = 10) -> list[Epoch]:
    epochs = [measured(GPS, START_S + 0.2 * k) for k in range(count)]
    for k in range(reflected_from, count):
        pseudorange = epochs[k].pseudorange_m.copy()
        pseudorange[int(np.argmin(epochs[k].doppler_hz))] += 80.0
        epochs[k] = msgspec.structs.replace(epochs[k], pseudorange_m=pseudorange)
    return epochs


def recording(epochs: Sequence[Epoch], device: str = "front") -> list[Sample]:
    return [*broadcast(device, t_ns=epochs[0].t_ns - 1), *(epoch_sample(epoch, device) for epoch in epochs)]


def fixes(samples: Sequence[Sample], **fields: str) -> list[Fix]:
    found = []
    for sample in samples:
        address = topic_of(sample.key)
        assert address is not None
        if address.topic in (GNSS_FIX, GNSS_COMPARISON) and fields.items() <= address.fields.items():
            found.append(decode(Fix, sample.payload))
    return found


def off_by_m(fix: Fix) -> float:
    return float(np.linalg.norm(enu_about(PLACE_DEG, fix.lat_deg or 0.0, fix.lon_deg or 0.0, fix.h_m or 0.0)))


def test_every_epoch_is_answered_by_every_method() -> None:
    epochs = drive()
    heard = replay_through(recording(epochs), [SERVICE])
    assert len(heard) == 4 * len(epochs)
    primary = [fix for fix in fixes(heard) if fix.method == "robust"]
    assert [fix.tow_s for fix in primary] == [epoch.tow_s for epoch in epochs]
    assert [fix.t_ns for fix in primary] == [epoch.t_ns for epoch in epochs]
    original, remove = fixes(heard, method="original"), fixes(heard, method="remove")
    assert (len(original), len(remove)) == (len(epochs), len(epochs))
    assert off_by_m(original[10]) > 5.0
    assert off_by_m(remove[10]) < 0.01
    # Weights hold the reflected signal back, they do not take it out.
    assert off_by_m(primary[10]) < 0.5
    verdicts = [decode(Verdicts, s.payload) for s in heard if s.key == GNSS_VERDICT.at(TRAIN, device="front")]
    assert [sum(one.flagged for one in epoch.satellites) for epoch in verdicts] == [0] * 10 + [1] * 6


def test_the_same_recording_gives_the_same_bytes() -> None:
    samples = recording(drive())
    first, second = (replay_through(samples, [SERVICE]) for _ in range(2))
    assert [(one.key, one.payload) for one in first] == [(one.key, one.payload) for one in second]


def test_two_receivers_of_a_train_are_kept_apart() -> None:
    front, rear = drive(), drive(reflected_from=16)
    mixed = [*broadcast("front", t_ns=front[0].t_ns - 1), *broadcast("rear", t_ns=front[0].t_ns - 1)]
    for one, other in zip(front, rear, strict=True):
        mixed += [epoch_sample(one, "front"), epoch_sample(other, "rear")]
    heard = replay_through(mixed, [SERVICE])
    assert fixes(heard, device="front") == fixes(replay_through(recording(front), [SERVICE]), device="front")
    assert all(fix.satellites_flagged == 0 for fix in fixes(heard, device="rear"))


def test_method_and_comparison_are_settings() -> None:
    config = Config(method="original", compare=("adjust",))
    heard = replay_through(recording(drive()), [SERVICE], {"gnss_correction": config})
    assert {fix.method for fix in fixes(heard)} == {"original", "adjust"}
    assert {key.topic for key in map(topic_of, (one.key for one in heard)) if key} == {
        GNSS_FIX,
        GNSS_COMPARISON,
        GNSS_VERDICT,
    }


def test_ephemerides_may_come_late() -> None:
    epochs = drive(reflected_from=16)
    samples = [epoch_sample(epochs[0]), *broadcast(t_ns=epochs[1].t_ns - 1), *map(epoch_sample, epochs[1:])]
    primary = [fix for fix in fixes(replay_through(samples, [SERVICE])) if fix.method == "robust"]
    assert [fix.status for fix in primary] == ["none"] + ["fix"] * 15
    assert "no ephemeris" in primary[0].reason


def test_a_recording_that_starts_over_is_followed_again() -> None:
    epochs = drive(reflected_from=16)
    again = [msgspec.structs.replace(one, t_ns=one.t_ns + 10**10) for one in epochs]
    heard = replay_through([*recording(epochs), *map(epoch_sample, again)], [SERVICE])
    second = [fix.status for fix in fixes(heard) if fix.method == "robust"][16:]
    assert second == ["none"] * 4 + ["fix"] * 12


@pytest.mark.parametrize("count", [MOST_DEVICES, MOST_DEVICES + 3])
def test_more_receivers_than_a_train_can_have_are_refused(count: int) -> None:
    epoch = drive(1)[0]
    heard = replay_through([epoch_sample(epoch, f"device{k}") for k in range(count)], [SERVICE])
    assert len(fixes(heard)) == 3 * MOST_DEVICES


def test_health_says_while_there_is_no_fix() -> None:
    epochs = drive(8, reflected_from=8)
    with manual_loop() as loop:
        from services.recorder.offline_replay import OfflineReplay  # noqa: PLC0415 - beside its only use

        run = OfflineReplay(loop, [Part(SERVICE, Config(), "gnss_correction")], lambda _sample: None)
        run.feed(epoch_sample(epochs[0]))
        loop.settle()
        (node,) = (part.node for part in run._runs.values())
        level, reasons = node.health.level(0.0)
        assert level == "degraded"
        assert reasons[0].startswith("no fix from front: 0 usable of ")
        for sample in recording(epochs[1:]):
            run.feed(sample)
        loop.settle()
        assert node.health.level(1.0) == ("ok", ())
        assert node.health.counts == {"epochs": 8, "epochs_none": 1, "epochs_fix": 7}
        run.finish()


def test_the_service_ends_when_asked() -> None:
    heard: list[Sample] = []
    run = replay(recording(drive(2)), [Part(SERVICE, Config(), "gnss_correction")], heard.append)
    assert run.fed == 2 + len(GPS) + 1
    assert len(heard) == 8


def test_the_service_loads_the_thresholds_of_its_receiver(tmp_path: Path) -> None:
    band = Band(system="G", lowest_deg=0.0, highest_deg=90.0, threshold_m=200.0)
    path = tmp_path / "thresholds.toml"
    write_thresholds(path, Thresholds(receiver="front", bands=(band,)))
    flagged = {}
    for name in ("", str(path)):
        heard: list[Sample] = []
        settings = Config(method="original", compare=(), thresholds_file=name)
        replay(recording(drive()), [Part(SERVICE, settings, "gnss_correction")], heard.append)
        flagged[name] = sum(fix.satellites_flagged for fix in fixes(heard))
    # The reflection of 80 m stays below a threshold of 200 m.
    assert flagged[str(path)] == 0
    assert flagged[""] > 0


def test_the_service_does_not_start_with_broken_thresholds(tmp_path: Path) -> None:
    path = tmp_path / "thresholds.toml"
    path.write_text("version = 1")
    settings = Config(thresholds_file=str(path))
    with pytest.raises(ReplayError, match=r"thresholds\.toml: Object missing required field"):
        replay(recording(drive(1)), [Part(SERVICE, settings, "gnss_correction")], lambda _sample: None)
