"""No best real run is cheaper than the optimum of its own running time under its own limits."""

from __future__ import annotations

import os
from pathlib import Path

import duckdb
import pytest

from benchmarks.optimum import compared
from services.line.import_file import import_from_files
from services.line.line_import import Wishes
from services.run_history.vehicle import Vehicle

FIELD = os.environ.get("KIROTEI_FIELD_DATA")
HUNGARY = Path(FIELD or "") / "runs" / "hungary_line80"
TRAIN = Vehicle(name="FLIRT", mass_t=120.0, load_t=20.0, max_speed_mps=44.4)

pytestmark = pytest.mark.skipif(not FIELD, reason="KIROTEI_FIELD_DATA names no folder of real logs")


def test_the_optimum_is_never_above_the_best_real_run(tmp_path: Path) -> None:
    files = (HUNGARY / "axis.geojson", HUNGARY / "stations.geojson", HUNGARY / "profile.csv")
    line = import_from_files(*files, Wishes(gauge_m=1.435)).line
    log = tmp_path / "runs.csv"
    with duckdb.connect() as connection:
        connection.execute(
            f"COPY (SELECT t AS t_unix_s, lat AS lat_deg, lon AS lon_deg, v AS speed_mps, run AS run_id "  # noqa: S608 - our own paths
            f"FROM '{HUNGARY / 'runs.parquet'}' WHERE rx = 'phone') TO '{log}'"
        )
    found = list(compared(line, TRAIN, log, cheapest=True))
    assert len(found) >= 2 * 10  # sections, each with the limits of all runs and with its own
    assert [one.name for one in found if one.share is None] == []
    # 5 % below at the least today; the line knows no limits, so that these are what the runs themselves did.
    assert max(one.share for one in found if one.share is not None) <= 0.0
