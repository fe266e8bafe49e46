"""The store on ClickHouse, for a fleet: rows on its nodes, what is only ours beside us.

Rows go through a Distributed table, synchronously: a commit is answered once the shards have it. What the
far end of a bridge must remember (what was had, what is still to be said again) stays in a small embedded
store, written after the rows: a crash between the two brings a batch again, and its rows replace themselves,
for they are the same (ReplacingMergeTree over key, source, boot id and sequence, read with FINAL).
Of the SQL dialect only what the versions from 18.16 on understand is used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from schemas.bridge import BridgedRecord, StoreAnswer, StoreQuestion
from services.cloud_analyzer.clickhouse_socket import UNREACHABLE_CODES, ClickHouseError, Node, UnreachableError
from services.cloud_analyzer.duckdb_store import DuckDbStore, day_of
from services.cloud_analyzer.history import DAY_NS, SECTION_M, Commit, Learned, SectionSums, StoreError, days_of
from services.cloud_analyzer.history_sql import Dialect, learning_sql, literals, merging_sql, sql_of
from services.cloud_analyzer.pages import page_of
from services.cloud_analyzer.result_tables import RESULTS, Findings
from services.cloud_analyzer.sums_page import sums_answer
from services.cloud_analyzer.tables import RADIO, TABLES, Kind, Rows, Table, Value
from services.lte_bridge.deduplication import StateRow

T = TypeVar("T")
END_S: Final = 5.0
"""A node ends a question by itself when its time is over; it is waited for so much longer."""
DIALECT: Final = Dialect("toInt64(intDiv(taken_ns, 86400000000000))", "toInt64(floor({x}))")
_TYPES: Final[dict[Kind, str]] = {"bigint": "Int64", "double": "Nullable(Float64)", "varchar": "String"}


class ClickHouseStore:
    """History on one node or on a cluster."""

    def __init__(
        self,
        nodes: Sequence[Node],
        folder: Path,
        *,
        line: str,
        database: str,
        cluster: str = "",
        keep_days: float = 400.0,
    ) -> None:
        """Make the tables where they are missing, on every node. Raises StoreError when a node is away.

        `line`: the nodes hold every analyzer's lines; ours alone is answered about and learned from.
        `cluster`: its name in ClickHouse's own configuration; empty for a single node.
        """
        if not database.isidentifier() or (cluster and not cluster.isidentifier()):
            msg = f"{database!r} and {cluster!r} must be plain names"
            raise StoreError(msg)
        self._nodes = list(nodes)
        self._line = line
        self._database = database
        self._cluster = cluster
        self._keep_days = keep_days
        self._own = DuckDbStore(folder)
        for node in self._nodes:
            self._make_tables(node)

    @property
    def set_aside(self) -> str:
        """Where a damaged own store was put, and why; empty when all was well."""
        return self._own.set_aside

    def _make_tables(self, node: Node) -> None:
        node.execute(f"CREATE DATABASE IF NOT EXISTS {self._database}")
        for table in (*TABLES, *RESULTS):
            columns = ", ".join(f"{name} {_TYPES[kind]}" for name, kind in table.columns)
            order = ", ".join(_order(table))
            node.execute(
                f"CREATE TABLE IF NOT EXISTS {self._database}.{table.name}_here ({columns}) "
                "ENGINE = ReplacingMergeTree() "
                f"PARTITION BY toDate(toDateTime(intDiv(taken_ns, 1000000000), 'UTC')) ORDER BY ({order})"
            )
            if self._cluster:
                here = f"{table.name}_here"
                node.execute(
                    f"CREATE TABLE IF NOT EXISTS {self._database}.{table.name} AS {self._database}.{here} "
                    f"ENGINE = Distributed({self._cluster}, {self._database}, {here}, cityHash64({table.shard_by}))"
                )
            self._add_columns(node, table)

    def _add_columns(self, node: Node, table: Table) -> None:
        """Columns that tables of an older version lack; they stand last."""
        for name in (f"{table.name}_here", table.name)[: 2 if self._cluster else 1]:
            have = node.rows(
                f"SELECT name FROM system.columns WHERE database = '{self._database}' AND table = '{name}'"  # noqa: S608 - names are our own
            )
            for column, kind in table.columns:
                if [column] not in have:
                    node.execute(f"ALTER TABLE {self._database}.{name} ADD COLUMN {column} {_TYPES[kind]}")

    def _name(self, table: Table) -> str:
        return f"{self._database}.{table.name}" if self._cluster else f"{self._database}.{table.name}_here"

    def _any(self, work: Callable[[Node], T]) -> T:
        """Result from the first node that can be reached."""
        away: UnreachableError | None = None
        for node in list(self._nodes):
            try:
                return work(node)
            except UnreachableError as error:
                away = error
                # Ask another one first from now on; another thread may be doing the same.
                self._nodes = [*(one for one in self._nodes if one is not node), node]
        raise away or UnreachableError("no node is configured")

    def commit(self, commit: Commit) -> int:
        """Rows on the nodes, then what is ours; see `Store.commit`."""
        for table in TABLES:
            self._insert(table, commit.rows.of(table))
        return self._own.commit(Commit(Rows(), commit.had, commit.forgotten, commit.outbox))

    def keep(self, findings: Findings) -> None:
        """Models and what they found; see `Store.keep`."""
        for table in RESULTS:
            self._insert(table, findings.of(table))

    def _insert(self, table: Table, rows: Sequence[Sequence[Value]]) -> None:
        if rows:
            body = b"\n".join(msgspec.json.encode(dict(zip(table.names, row, strict=True))) for row in rows)
            sql = f"INSERT INTO {self._name(table)} FORMAT JSONEachRow"
            self._any(lambda node: node.execute(sql, body, {"insert_distributed_sync": 1}))

    def published(self, number: int) -> None:
        """Forget outbox entries; see `Store.published`."""
        self._own.published(number)

    def unpublished(self) -> Iterable[tuple[int, Sequence[BridgedRecord]]]:
        """Outbox entries; see `Store.unpublished`."""
        return self._own.unpublished()

    def had(self) -> Iterable[StateRow]:
        """What was had; see `Store.had`."""
        return self._own.had()

    def ask(self, question: StoreQuestion, timeout_s: float) -> StoreAnswer:
        """A page, partial when shards are away; see `Store.ask`."""
        if question.about == "radio_sums":
            return sums_answer(question, self.learn(*days_of(question), by_day=True, timeout_s=timeout_s))
        asked = sql_of(question, self._line)
        sql = literals(asked.sql.replace("FROM relation", f"FROM {self._name(asked.table)} FINAL", 1), asked.parameters)
        found, partial = self._read(sql, timeout_s)
        return page_of(question, asked, found, partial)

    def learn(
        self,
        first_day: int | None = None,
        last_day: int | None = None,
        *,
        by_day: bool = False,
        timeout_s: float = 600.0,
    ) -> Learned:
        """Sums from every row of the line, partial when shards are away; see `Store.learn`."""
        bounds = ((">=", first_day), ("<", None if last_day is None else last_day + 1))
        conditions = [f"taken_ns {sign} {day * DAY_NS}" for sign, day in bounds if day is not None]
        where = " AND ".join(["line = {line:String}", *conditions])
        relation = literals(f"(SELECT * FROM {self._name(RADIO)} FINAL WHERE {where})", {"line": self._line})  # noqa: S608 - numbers of our own
        passes = learning_sql(relation, SECTION_M, DIALECT)
        rows, partial = self._read(merging_sql(f"({passes})", by_day=by_day), timeout_s)
        return Learned(tuple(map(SectionSums._make, rows)), partial)

    def _read(self, sql: str, timeout_s: float) -> tuple[list[list[Any]], str]:
        """Rows, and what is missing when shards are away: never fewer rows without a word."""
        settings: dict[str, str | int] = {"max_execution_time": max(1, round(timeout_s)), "skip_unavailable_shards": 0}
        patience_s = timeout_s + END_S
        try:
            return self._any(lambda node: node.rows(sql, settings, patience_s)), ""
        except ClickHouseError as error:
            if not self._cluster or error.code not in UNREACHABLE_CODES:
                raise
            reason = str(error)
        rows = self._any(lambda node: node.rows(sql, settings | {"skip_unavailable_shards": 1}, patience_s))
        return rows, f"at least one shard of {self._cluster} did not answer: {reason[:200]}"

    def tend(self, now_ns: int) -> str:
        """Drop days older than they are kept, on every node; see `Store.tend`."""
        oldest = day_of(int(now_ns - self._keep_days * DAY_NS))
        dropped = 0
        for node in self._nodes:
            for table in (*TABLES, *RESULTS):
                days = node.rows(
                    "SELECT DISTINCT partition FROM system.parts "  # noqa: S608 - names are our own
                    f"WHERE active AND database = '{self._database}' AND table = '{table.name}_here' "
                    f"AND partition < '{oldest}'"
                )
                for (day,) in days:
                    name = str(day).strip("'")
                    node.execute(f"ALTER TABLE {self._database}.{table.name}_here DROP PARTITION '{name}'")
                    dropped += 1
        self._own.tend(now_ns)
        return f"{dropped} days older than {oldest} dropped" if dropped else ""

    def close(self) -> None:
        """End it; see `Store.close`."""
        for node in self._nodes:
            node.close()
        self._own.close()


def _order(table: Table) -> tuple[str, ...]:
    """What tells rows apart that replace each other."""
    if table in RESULTS:
        return ("line", *table.order)
    return tuple(name for name, kind in table.columns if kind != "double" and name != "message")
