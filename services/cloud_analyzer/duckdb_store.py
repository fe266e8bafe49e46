"""The store on DuckDB, embedded: a database file for what is new, day files in Parquet for what is closed.

One writer process; DuckDB refuses a second on the same file. A commit is on disk when it returns (DuckDB's
log is synced at each). Closed days move into `raw/<table>/day=YYYY-MM-DD/…parquet`; a day file counts once
the database names it, so that a crash between the two leaves no row twice and none out.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, Final

import duckdb
import numpy as np

from schemas.bridge import BridgedRecord, StoreAnswer, StoreQuestion
from services.cloud_analyzer.day_file import DAY_SQL, write_day
from services.cloud_analyzer.history import (
    DAY_NS,
    SECTION_M,
    Commit,
    Learned,
    SectionSums,
    StoreError,
    StoreTimeoutError,
    days_of,
)
from services.cloud_analyzer.history_sql import Dialect, dollars, learning_sql, merging_sql, sql_of
from services.cloud_analyzer.pages import page_of
from services.cloud_analyzer.result_tables import MODELS, RESULTS, Findings
from services.cloud_analyzer.sums_page import sums_answer
from services.cloud_analyzer.tables import RADIO, TABLES, Kind, Table
from services.lte_bridge.batch import packed, unpacked
from services.lte_bridge.deduplication import StateRow

DATABASE: Final = "history.duckdb"
DIALECT: Final = Dialect("CAST(taken_ns // 86400000000000 AS INTEGER)", "CAST(floor({x}) AS INTEGER)")
FILES: Final = "read_parquet($files, union_by_name=true, hive_partitioning=false)"


class DuckDbStore:
    """History on DuckDB in a folder of its own."""

    def __init__(self, folder: Path, *, keep_days: float = 400.0, open_days: int = 2, threads: int = 1) -> None:
        """Open or make the store; a database that cannot be read is set aside. Raises StoreError.

        `keep_days`: older day files are deleted; `open_days`: so many days stay in the database.
        """
        self._folder = folder
        self._keep_days = keep_days
        self._open_days = open_days
        self.set_aside = ""
        """Where a damaged database was put, and why; empty when all was well."""
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._database = folder / DATABASE
        try:
            self._connection = self._open(threads)
        except duckdb.IOException as error:
            if "lock" in str(error).lower():
                msg = f"{self._database} is in use by another analyzer: one writer at a time"
                raise StoreError(msg) from error
            self._connection = self._begin_anew(error, threads)
        except duckdb.Error as error:
            self._connection = self._begin_anew(error, threads)
        self._adopt_files()

    def _open(self, threads: int) -> duckdb.DuckDBPyConnection:
        connection = duckdb.connect(str(self._database))
        try:
            connection.execute(f"SET threads={int(threads)}")
            connection.execute("SET TimeZone='UTC'")
            for table in (*TABLES, *RESULTS):
                columns = ", ".join(f"{name} {kind}" for name, kind in table.columns)
                connection.execute(f"CREATE TABLE IF NOT EXISTS {table.name} ({columns})")
                # A database of an older version lacks the newest columns, which stand last.
                for name, kind in table.columns:
                    connection.execute(f"ALTER TABLE {table.name} ADD COLUMN IF NOT EXISTS {name} {kind}")
            connection.execute("CREATE TABLE IF NOT EXISTS had (name VARCHAR PRIMARY KEY, state BLOB, used BIGINT)")
            connection.execute("CREATE TABLE IF NOT EXISTS outbox (number BIGINT, count BIGINT, compressed BLOB)")
            connection.execute(
                "CREATE TABLE IF NOT EXISTS parts (path VARCHAR, table_name VARCHAR, day VARCHAR, rows BIGINT)"
            )
            connection.execute(
                "CREATE TABLE IF NOT EXISTS sums (day BIGINT, radio VARCHAR, channel VARCHAR, direction VARCHAR, "
                "cell VARCHAR, section BIGINT, n BIGINT, s DOUBLE, ss DOUBLE)"
            )
            self._number = int(_one(connection, "SELECT coalesce(max(number), 0) FROM outbox"))
        except BaseException:
            connection.close()
            raise
        return connection

    def _begin_anew(self, error: duckdb.Error, threads: int) -> duckdb.DuckDBPyConnection:
        stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
        aside = self._database.with_name(f"{DATABASE}.damaged-{stamp}")
        for path in (self._database, self._database.with_name(f"{DATABASE}.wal")):
            with suppress(FileNotFoundError):
                path.replace(path.with_name(path.name.replace(DATABASE, aside.name)))
        self.set_aside = f"{aside}: {str(error).splitlines()[0]}"
        try:
            return self._open(threads)
        except duckdb.Error as again:
            msg = f"no store can be made in {self._folder}: {again}"
            raise StoreError(msg) from again

    def _adopt_files(self) -> None:
        """Forget day files that the database does not name, or all of them back when it was begun anew."""
        known = {path for (path,) in self._connection.execute("SELECT path FROM parts").fetchall()}
        for path in sorted((self._folder / "raw").glob("*/day=*/*")):
            name = str(path.relative_to(self._folder))
            if name in known:
                continue
            if not self.set_aside or path.suffix != ".parquet":
                path.unlink()
                continue
            rows = int(_one(self._connection, "SELECT count(*) FROM read_parquet(?)", [str(path)]))
            day = path.parts[-2].removeprefix("day=")
            entry = [name, path.parts[-3], day, rows]
            self._connection.execute("INSERT INTO parts VALUES (?, ?, ?, ?)", entry)
            if name.startswith("raw/radio/"):
                self._keep_sums(self._connection, day)

    def commit(self, commit: Commit) -> int:
        """Everything of one transaction, on disk; see `Store.commit`."""
        number = self._number + 1
        with self._transaction() as connection:
            for table in TABLES:
                _insert(connection, table, commit.rows.of(table))
            for row in commit.had:
                connection.execute("INSERT OR REPLACE INTO had VALUES (?, ?, ?)", [row.name, row.state, row.used])
            if commit.forgotten:
                connection.execute("DELETE FROM had WHERE name IN (SELECT unnest(?))", [list(commit.forgotten)])
            if commit.outbox:
                values = [number, len(commit.outbox), packed(commit.outbox)]
                connection.execute("INSERT INTO outbox VALUES (?, ?, ?)", values)
        self._number = number
        return number

    @contextmanager
    def _transaction(self) -> Iterator[duckdb.DuckDBPyConnection]:
        connection = self._connection
        try:
            connection.execute("BEGIN")
            yield connection
            connection.execute("COMMIT")
        except (duckdb.Error, OSError) as error:
            with suppress(duckdb.Error):  # the transaction has ended by itself
                connection.execute("ROLLBACK")
            msg = f"the store in {self._folder} took nothing: {str(error).splitlines()[0]}"
            raise StoreError(msg) from error
        except BaseException:
            with suppress(duckdb.Error):
                connection.execute("ROLLBACK")
            raise

    def published(self, number: int) -> None:
        """Forget outbox entries; see `Store.published`."""
        with self._transaction() as connection:
            connection.execute("DELETE FROM outbox WHERE number <= ?", [number])

    def unpublished(self) -> Iterable[tuple[int, Sequence[BridgedRecord]]]:
        """Outbox entries; see `Store.unpublished`."""
        entries = self._connection.execute("SELECT number, compressed, count FROM outbox ORDER BY number").fetchall()
        return [(number, unpacked(compressed, count)) for number, compressed, count in entries]

    def had(self) -> Iterable[StateRow]:
        """What was had; see `Store.had`."""
        rows = self._connection.execute("SELECT name, state, used FROM had").fetchall()
        return [StateRow(name, state, used) for name, state, used in rows]

    def ask(self, question: StoreQuestion, timeout_s: float) -> StoreAnswer:
        """A page; see `Store.ask`. May run in another thread than the commits."""
        if question.about == "radio_sums":
            return sums_answer(question, self.learn(*days_of(question), by_day=True, timeout_s=timeout_s))
        asked = sql_of(question, "")  # a folder holds one line
        relation, files = self._relation(asked.table, question.from_ns, question.until_ns)
        sql = dollars(asked.sql.replace("FROM relation", f"FROM {relation}", 1))
        return page_of(question, asked, self._read(sql, asked.parameters | files, timeout_s))

    def keep(self, findings: Findings) -> None:
        """Models and what they found; see `Store.keep`."""
        with self._transaction() as connection:
            for table in RESULTS:
                rows = findings.of(table)
                at = table.names.index(table.shard_by)
                if table is not MODELS:
                    before = [list({row[at] for row in rows})]
                    connection.execute(f"DELETE FROM {table.name} WHERE {table.shard_by} IN (SELECT unnest(?))", before)  # noqa: S608 - names are our own
                _insert(connection, table, rows)

    def learn(
        self,
        first_day: int | None = None,
        last_day: int | None = None,
        *,
        by_day: bool = False,
        timeout_s: float = 600.0,
    ) -> Learned:
        """Sums of closed days as they are kept, of open ones from their rows; see `Store.learn`."""
        days = {"first": -(2**31) if first_day is None else first_day, "last": 2**31 if last_day is None else last_day}
        live = learning_sql(RADIO.name, SECTION_M, DIALECT)
        both = f"(SELECT * FROM sums UNION ALL {live})"  # noqa: S608 - names are our own
        sql = merging_sql(f"(SELECT * FROM {both} WHERE day BETWEEN $first AND $last)", by_day=by_day)  # noqa: S608 - the same
        return Learned(tuple(map(SectionSums._make, self._read(sql, days, timeout_s))))

    def learn_from_rows(self, *, by_day: bool = False) -> Learned:
        """The same from every row there is: to check what is kept."""
        relation, parameters = self._relation(RADIO, None, None)
        sql = merging_sql(f"({learning_sql(relation, SECTION_M, DIALECT)})", by_day=by_day)
        return Learned(tuple(map(SectionSums._make, self._read(sql, parameters, 600.0))))

    def _relation(self, table: Table, from_ns: int | None, until_ns: int | None) -> tuple[str, dict[str, Any]]:
        """What stands behind FROM: the open days' table and the day files that may matter."""
        first = "0000-00-00" if from_ns is None else day_of(from_ns)
        last = "9999-99-99" if until_ns is None else day_of(until_ns)
        parts = self._connection.cursor().execute(
            "SELECT path FROM parts WHERE table_name = ? AND day BETWEEN ? AND ? ORDER BY path",
            [table.name, first, last],
        )
        paths = [str(self._folder / path) for (path,) in parts.fetchall()]
        if not paths:
            return table.name, {}
        columns = ", ".join(table.names)
        # By name: files of an older version lack the newest columns.
        both = f"SELECT {columns} FROM {table.name} UNION ALL BY NAME SELECT * FROM {FILES}"  # noqa: S608 - names are our own
        return f"({both})", {"files": paths}

    def _read(self, sql: str, parameters: dict[str, Any], timeout_s: float) -> list[tuple[Any, ...]]:
        cursor = self._connection.cursor()
        watch = threading.Timer(timeout_s, cursor.interrupt)
        watch.start()
        try:
            return cursor.execute(sql, parameters or None).fetchall()
        except duckdb.InterruptException as error:
            msg = f"not answered within {timeout_s:g} s: ask for a shorter time or stretch"
            raise StoreTimeoutError(msg) from error
        except duckdb.Error as error:
            msg = f"the store in {self._folder} cannot answer: {str(error).splitlines()[0]}"
            raise StoreError(msg) from error
        finally:
            watch.cancel()
            cursor.close()

    def tend(self, now_ns: int) -> str:
        """Close days and forget old ones; see `Store.tend`."""
        closed = day_of(now_ns - self._open_days * DAY_NS)
        done = [said for table in TABLES for said in self._close_days(table, closed)]
        oldest = day_of(int(now_ns - self._keep_days * DAY_NS))
        old = self._connection.execute("SELECT path FROM parts WHERE day < ?", [oldest]).fetchall()
        with self._transaction() as connection:
            for table in RESULTS:
                connection.execute(f"DELETE FROM {table.name} WHERE {DAY_SQL} < ?", [oldest])  # noqa: S608 - names are our own
            connection.execute("DELETE FROM sums WHERE day < ?", [number_of(oldest)])
        if old:
            with self._transaction() as connection:
                connection.execute("DELETE FROM parts WHERE day < ?", [oldest])
            for (path,) in old:
                with suppress(FileNotFoundError):
                    (self._folder / path).unlink()
            done.append(f"{len(old)} files older than {oldest} deleted")
        return "; ".join(done)

    def _close_days(self, table: Table, closed: str) -> Iterator[str]:
        days = self._connection.execute(
            f"SELECT {DAY_SQL} AS day, count(*) FROM {table.name} GROUP BY day HAVING day <= ? ORDER BY day",  # noqa: S608 - names are our own
            [closed],
        ).fetchall()
        for day, count in days:
            path = write_day(self._connection, self._folder, table, day)
            with self._transaction() as connection:
                entry = [str(path.relative_to(self._folder)), table.name, day, count]
                connection.execute("INSERT INTO parts VALUES (?, ?, ?, ?)", entry)
                connection.execute(f"DELETE FROM {table.name} WHERE {DAY_SQL} = ?", [day])  # noqa: S608 - names are our own
                if table is RADIO:
                    self._keep_sums(connection, day)
            yield f"{count} rows of {table.name} of {day} into {path.name}"
        if days:
            self._connection.execute("CHECKPOINT")

    def _keep_sums(self, connection: duckdb.DuckDBPyConnection, day: str) -> None:
        """Sums of a closed day, from all files that it has by now."""
        found = connection.execute("SELECT path FROM parts WHERE table_name = 'radio' AND day = ?", [day]).fetchall()
        files = [str(self._folder / path) for (path,) in found]
        number = number_of(day)
        connection.execute("DELETE FROM sums WHERE day = ?", [number])
        sql = f"INSERT INTO sums {learning_sql(FILES, SECTION_M, DIALECT, day=number)}"
        connection.execute(sql, {"files": files})

    def close(self) -> None:
        """End it; see `Store.close`."""
        self._connection.close()


def _insert(connection: duckdb.DuckDBPyConnection, table: Table, rows: list[tuple[Any, ...]]) -> None:
    if not rows:
        return
    columns = list(zip(*rows, strict=True))
    batch = {name: _column(column, kind) for (name, kind), column in zip(table.columns, columns, strict=True)}
    connection.register("batch", batch)
    try:
        connection.execute(f"INSERT INTO {table.name} BY NAME SELECT * FROM batch")  # noqa: S608 - names are our own
    finally:
        connection.unregister("batch")


def _column(values: tuple[Any, ...], kind: Kind) -> Any:  # noqa: ANN401 - an array of the column's type
    if kind == "bigint":
        return np.array(values, dtype=np.int64)
    if kind == "varchar":
        return np.array(values, dtype=object)
    # None becomes NaN on the way, and both become NULL: no honest sender says NaN.
    array = np.array(values, dtype=np.float64)
    missing = np.isnan(array)
    return np.ma.masked_array(array, mask=missing) if missing.any() else array


def _one(connection: duckdb.DuckDBPyConnection, sql: str, parameters: list[Any] | None = None) -> Any:  # noqa: ANN401 - whatever stands there
    row = connection.execute(sql, parameters).fetchone()
    return None if row is None else row[0]


def day_of(t_ns: int) -> str:
    """UTC day of a time, ISO 8601."""
    return datetime.fromtimestamp(max(t_ns, 0) / 1e9, UTC).strftime("%Y-%m-%d")


def number_of(day: str) -> int:
    """Its number, counted from 1970."""
    return (date.fromisoformat(day) - date(1970, 1, 1)).days
