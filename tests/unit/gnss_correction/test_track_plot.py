"""The map of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from services.gnss_correction.evaluation import FixTrack, Polyline
from services.gnss_correction.track_plot import save_tracks

LINE = Polyline(np.linspace(35.0, 35.002, 20), np.linspace(135.0, 135.004, 20), np.zeros(20), np.arange(20.0))


def track(name: str, shift_deg: float, count: int = 20) -> FixTrack:
    fixed = np.arange(20) < count
    return FixTrack(name, np.arange(20.0), fixed, LINE.lat_deg + shift_deg, LINE.lon_deg, np.zeros(20))


TRACKS = [track("original", 2e-4), track("remove", 0.0, 15), track("adjust", -1e-4), track("far", 1.0)]
STATIONS = [("大手町", 35.001, 135.002)]
"""Written right whatever fonts there are."""


def test_the_map_names_what_it_shows(tmp_path: Path) -> None:
    path = tmp_path / "map.svg"
    save_tracks(path, TRACKS, LINE, stations=STATIONS)
    text = path.read_text("utf-8")
    for words in (
        "original: 20 of 20 epochs",
        "remove: 15 of 20 epochs",
        "adjust: 20 of 20 epochs",
        "far: 20 of 20 epochs, 20 off the map",
        "大手町",
        "east [m]",
        "north [m]",
        "50 m",
    ):
        assert f">{words}</text>" in text
    for colour in ("#24305e", "#38b6e0", "#e8479b"):
        assert colour in text


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_the_same_input_gives_the_same_bytes(tmp_path: Path, kind: str) -> None:
    paths = [tmp_path / f"{name}.{kind}" for name in ("one", "two")]
    for path in paths:
        save_tracks(path, TRACKS, None, LINE, STATIONS)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in paths}
    assert (paths[0].read_bytes()[:4] == b"\x89PNG") == (kind == "png")


def test_without_a_line_the_fixes_make_the_frame(tmp_path: Path) -> None:
    save_tracks(tmp_path / "map.svg", [track("original", 0.0)])
    assert "original: 20 of 20 epochs</text>" in (tmp_path / "map.svg").read_text("utf-8")


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="neither a line nor a fix"):
        save_tracks(tmp_path / "map.svg", [track("original", 0.0, 0)])
    with pytest.raises(ValueError, match=r"map\.pdf: a plot is \.png or \.svg"):
        save_tracks(tmp_path / "map.pdf", TRACKS, LINE)
    assert list(tmp_path.iterdir()) == []
