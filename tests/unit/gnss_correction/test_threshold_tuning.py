"""Thresholds tuned on made-up changes and recordings whose noise is known, kept in files, and used."""

from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.gnss import Epoch
from schemas.thresholds import Band, Thresholds
from services.gnss_correction.evaluation import Polyline
from services.gnss_correction.multipath import MultipathDetector, Sight
from services.gnss_correction.pipeline import Correction
from services.gnss_correction.settings import Config
from services.gnss_correction.threshold_sweep import METHODS, SWEPT_M, sweep, sweep_table, swept_bands
from services.gnss_correction.threshold_tuning import Changes, bands_of, changes_of, joined, noise_factor
from services.gnss_correction.thresholds_file import read_thresholds, thresholds_text, write_thresholds
from tests.unit.gnss_correction.made_up_sky import PLACE_DEG, START_S, WEEK, constellation, measured

GPS = constellation()
NOISE_M = 0.4
EPOCHS = 150


@pytest.fixture(scope="module")
def noisy() -> list[Epoch]:
    """Half a minute of a standing receiver at 5 Hz whose code noise is white and known."""
    generator = np.random.default_rng(5)
    epochs = [measured(GPS, START_S + 0.2 * k) for k in range(EPOCHS)]
    return [
        msgspec.structs.replace(
            one, pseudorange_m=one.pseudorange_m + NOISE_M * generator.standard_normal(len(one.satellites))
        )
        for one in epochs
    ]


def informed(correction: Correction) -> None:
    for one in GPS:
        correction.add(one)


def made_up(count: int, sigma_m: float, *, elevation_deg: float = 50.0, dirty: int = 0, system: int = 0) -> Changes:
    generator = np.random.default_rng(1)
    change_m = np.abs(sigma_m * generator.standard_normal(count))
    change_m[:dirty] += 100.0
    clean = np.ones(count)
    clean[:dirty] = 0.0
    return Changes(np.full(count, system), np.full(count, elevation_deg), change_m, clean)


def test_the_noise_of_a_recording_is_recovered(noisy: list[Epoch]) -> None:
    correction = Correction(Config(method="original", compare=()))
    informed(correction)
    changes = joined([changes_of(correction.epoch(epoch)) for epoch in noisy])
    bands = [band for band in bands_of(changes, false_alarms=0.01, window_epochs=5) if band.clean >= 200]
    assert len(bands) >= 2
    for band in bands:
        # A median of some hundred correlated changes is known to a tenth.
        assert band.noise_m == pytest.approx(NOISE_M, rel=0.15)
        assert band.threshold_m == pytest.approx(2.576 * noise_factor(5) * NOISE_M, rel=0.15)
        assert band.basis == "band"


def test_the_tuned_share_of_clean_changes_is_flagged(noisy: list[Epoch]) -> None:
    correction = Correction(Config(method="original", compare=()))
    informed(correction)
    changes = joined([changes_of(correction.epoch(epoch)) for epoch in noisy])
    bands = bands_of(changes, false_alarms=0.05, window_epochs=5)
    tuned = Correction(Config(method="original", compare=()), thresholds=Thresholds(receiver="r", bands=bands))
    informed(tuned)
    flags = [
        one.flagged for epoch in noisy for one in tuned.epoch(epoch).judgements if one and one.change_m is not None
    ]
    assert 0.03 < np.mean(flags) < 0.06
    assert changes.clean.mean() > 0.95


def test_dirty_changes_do_not_raise_a_threshold() -> None:
    (band,) = [b for b in bands_of(made_up(2_000, 1.0, dirty=400), false_alarms=0.01, window_epochs=5) if b.judged]
    assert (band.judged, band.clean) == (2_000, 1_600)
    # Standard error of a 99 % quantile of 1600: about 0.1.
    assert band.threshold_m == pytest.approx(2.576, abs=0.3)


def test_a_spoilt_tail_does_not_raise_it_either() -> None:
    changes = made_up(2_000, 1.0)
    changes.change_m[:100] += 50.0
    (band,) = [b for b in bands_of(changes, false_alarms=0.01, window_epochs=5) if b.judged]
    assert (band.p99_m or 0.0) > 40.0
    assert band.threshold_m < 3.0


def test_a_band_with_few_clean_changes_takes_those_of_its_constellation_or_receiver() -> None:
    parts = [
        made_up(1_000, 1.0),
        made_up(50, 3.0, elevation_deg=20.0),
        made_up(50, 3.0, elevation_deg=20.0, system=2),
    ]
    bands = bands_of(joined(parts), false_alarms=0.01, window_epochs=5)
    basis = {(band.system, band.lowest_deg): band.basis for band in bands if band.judged}
    assert basis == {("G", 45.0): "band", ("G", 15.0): "constellation", ("E", 15.0): "receiver"}


def test_too_little_that_is_clean_is_said() -> None:
    with pytest.raises(ValueError, match="100 clean changes of 1000, 200 needed"):
        bands_of(made_up(1_000, 1.0, dirty=900), false_alarms=0.01, window_epochs=5)


@given(
    st.lists(
        st.builds(
            Band,
            system=st.sampled_from(["G", "R", "E", "C", "J"]),
            lowest_deg=st.floats(0.0, 45.0),
            highest_deg=st.floats(45.0, 90.0),
            threshold_m=st.floats(1e-3, 1e3),
            noise_m=st.none() | st.floats(0.0, 10.0),
        ),
        min_size=1,
        max_size=5,
    ),
    st.text(st.characters(codec="utf-8"), max_size=20),
)
def test_files_are_read_as_they_were_written(bands: list[Band], receiver: str) -> None:
    whole = Thresholds(receiver=receiver, bands=tuple(bands))
    assert msgspec.convert(tomllib.loads(thresholds_text(whole)), Thresholds) == whole


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("version = 1", "missing required field `receiver`"),
        ('version = 2\nreceiver = "r"\nbands = []', "version"),
        ('version = 1\nreceiver = "r"\nbands = []', "length >= 1"),
        ("no table", "line 1"),
        ('version = 1\nreceiver = "r"\n[[bands]]\nsystem = "X"\n', "bands"),
    ],
)
def test_a_file_that_is_none_is_refused_by_name(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "thresholds.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"thresholds\.toml: .*") as caught:
        read_thresholds(path)
    assert said in str(caught.value)


def test_a_file_replaces_an_older_one(tmp_path: Path) -> None:
    path = tmp_path / "thresholds.toml"
    band = Band(system="G", lowest_deg=0.0, highest_deg=90.0, threshold_m=0.5)
    for receiver in ("old", "new"):
        write_thresholds(path, Thresholds(receiver=receiver, bands=(band,)))
    assert read_thresholds(path).receiver == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_the_detector_goes_by_the_receivers_own_thresholds_where_there_are_some() -> None:
    band = Band(system="G", lowest_deg=30.0, highest_deg=90.0, threshold_m=7.0)
    detector = MultipathDetector(Config(), Thresholds(receiver="r", bands=(band,)))
    thresholds = {}
    for k in range(8):
        sights = [
            Sight(satellite, 0, 2e7 + 60.0 * k, float("nan"), elevation_rad)
            for satellite, elevation_rad in ((1, 1.0), (2, 0.4), (3, 0.1), (201, 1.0), (4, float("nan")))
        ]
        thresholds = {s.satellite: j.threshold_m for s, j in zip(sights, detector.judge(0.2 * k, sights), strict=True)}
    assert thresholds == {1: 7.0, 2: 0.45, 3: 0.75, 201: 0.45, 4: 0.45}


def test_the_sweep_shows_every_band_threshold_and_method(noisy: list[Epoch]) -> None:
    lat, lon, h = PLACE_DEG
    at = WEEK * 604_800.0 + START_S + np.arange(-1.0, 8.0)
    truth = Polyline(np.full(at.size, lat), np.full(at.size, lon), np.full(at.size, h), at)
    done: list[float] = []
    rows = sweep(
        Config(method="original", compare=()),
        lambda correction: [correction.epoch(epoch) for epoch in noisy[:30]],
        informed,
        truth=truth,
        line=None,
        progress=done.append,
    )
    assert len(rows) == len(swept_bands(Config())) * len(SWEPT_M) * len(METHODS)
    assert done[-1] == 1.0
    for band in swept_bands(Config()):
        flagged = [row.flagged_percent for row in rows if (row.lowest_deg, row.highest_deg) == band][:: len(METHODS)]
        assert flagged == sorted(flagged, reverse=True), "a higher threshold flags fewer"
    assert rows[0].flagged_percent > rows[2 * len(SWEPT_M) - 2].flagged_percent > 0.0
    assert all(row.mean_m is not None for row in rows if row.method == "adjust")
    table = sweep_table(rows).splitlines()
    assert len(table) == len(rows) + 1
    assert "100.00 %" in table[2]
