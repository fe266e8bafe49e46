"""What is asked about, page by page: run records by their fields, one line's rows, files that keep text as text."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import duckdb
import msgspec
import pytest

from schemas.bridge import StoreAnswer, StoreQuestion
from schemas.codec import encode
from schemas.runs import RunRecord
from schemas.topics import RUN_RECORD
from services.cloud_analyzer.duckdb_store import DuckDbStore
from services.cloud_analyzer.history_sql import sql_of
from services.cloud_analyzer.ingest import Ingest
from services.cloud_analyzer.pages import told
from services.cloud_analyzer.rows_file import RowsFile
from services.cloud_analyzer.runs_page import COLUMNS
from tests.unit.cloud_analyzer.batches import NOW_NS, STEP_NS, TRAIN, batch, measurement, record
from tests.unit.schemas.examples import EXAMPLES

CUT = RunRecord(t_ns=NOW_NS + STEP_NS, run_id="2", from_station="", to_station="juso", cut="start")


def test_run_records_come_out_as_they_went_in_and_once(tmp_path: Path) -> None:
    whole = EXAMPLES[RunRecord]
    assert isinstance(whole, RunRecord)
    said = [msgspec.structs.replace(whole, t_ns=NOW_NS), CUT]
    brought = [record(RUN_RECORD.at(TRAIN), encode(one), n, NOW_NS + n * STEP_NS) for n, one in enumerate(said)]
    with closing(DuckDbStore(tmp_path)) as store:
        ingest = Ingest("demo", store.had())
        for first in (0, 0, 2):  # lost acknowledgement; then the same records under other numbers of a spool begun anew
            taken = ingest.take(batch([*brought, measurement(0)], first), NOW_NS)
            store.commit(taken.commit)
            ingest.confirm(taken)
        question = StoreQuestion(t_ns=0, about="runs", limit=1)
        first_page = told(question, store.ask(question, 10.0))
        question = msgspec.structs.replace(question, page=first_page.next_page)
        second_page = told(question, store.ask(question, 10.0))
        assert second_page.next_page == ""
        rows = [*first_page.rows, *second_page.rows]
        assert first_page.columns == COLUMNS
        names = [field.name for field in msgspec.structs.fields(RunRecord)]
        assert [RunRecord(**dict(zip(names, row[-len(names) :], strict=True))) for row in rows] == said  # type: ignore[arg-type]  # as they were
        other = StoreQuestion(t_ns=0, about="runs", train="T2")
        assert told(other, store.ask(other, 10.0)).rows == ()


@pytest.mark.parametrize(("about", "column"), [("radio", "line"), ("models", "line"), ("reanalysed", "line")])
def test_a_line_s_analyzer_asks_for_its_own_rows(about: str, column: str) -> None:
    asked = sql_of(StoreQuestion(t_ns=0, about=about), "east")  # type: ignore[arg-type]  # one of them
    assert f"{column} = {{line:String}}" in asked.sql
    assert asked.parameters["line"] == "east"


def test_a_page_of_sums_is_cut_and_gone_on_with() -> None:
    rows = tuple((f"2026-01-{n:02d}", "r" * 500, n) for n in range(1, 31))
    question = StoreQuestion(t_ns=0, about="radio_sums", page="60")
    whole = StoreAnswer(t_ns=0, about="radio_sums", columns=("day", "radio", "n"), rows=rows, next_page="90")
    assert told(question, whole) == whole
    part = told(question, whole, most_bytes=6000)
    assert part.rows == rows[: len(part.rows)]
    assert len(encode(part)) <= 6000
    assert part.next_page == str(60 + len(part.rows))


@pytest.mark.parametrize("name", ["rows.parquet", "rows.csv"])
def test_text_that_looks_like_a_number_stays_text(tmp_path: Path, name: str) -> None:
    columns = ("channel", "boot_id", "sequence", "value", "nothing", "cell")
    rows = [("2412", "1e5", 2**62, 1.5, None, ""), ("007", "00", -1, None, None, "a,b\n")]
    with RowsFile(tmp_path / name) as file:
        for row in rows:  # a page each
            file.write(columns, [row])
    if name.endswith(".csv"):
        assert (tmp_path / name).read_text("utf-8").splitlines()[1] == "2412,1e5,4611686018427387904,1.5,,"
        return
    with duckdb.connect() as connection:
        assert connection.execute("SELECT * FROM read_parquet(?)", [str(tmp_path / name)]).fetchall() == rows
