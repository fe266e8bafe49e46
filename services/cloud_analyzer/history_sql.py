"""Questions to the history as SQL that DuckDB and ClickHouse both understand.

Parameters stand as `{name:Type}` (ClickHouse's form). Pages go on from the last row's own order columns,
so that rows that arrive meanwhile neither repeat nor shift anything.
"""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from typing import Final

import msgspec

from schemas.bridge import StoreQuestion
from services.cloud_analyzer.result_tables import MODEL_PARTS, MODELS, REANALYSED
from services.cloud_analyzer.tables import EVENTS, RADIO, Kind, Table
from services.radio_anomaly.reading import FARTHEST_M, LEAST_DBM, MOST_DBM

TABLE_OF: Final[dict[str, Table]] = {
    "radio": RADIO,
    "events": EVENTS,
    "radio_events": EVENTS,
    "runs": EVENTS,
    "models": MODELS,
    "model_parts": MODEL_PARTS,
    "reanalysed": REANALYSED,
}
"""What is asked about, and the table that holds it."""
TOPIC_OF: Final = {"radio_events": "radio/event", "runs": "run"}
_TYPES: Final[dict[Kind, str]] = {"bigint": "Int64", "double": "Float64", "varchar": "String"}
_PARAMETER = re.compile(r"\{(\w+):\w+\}")
SUM_KEYS: Final = ("day", "radio", "channel", "direction", "cell", "section")
Parameter = str | int | float


@dataclass(frozen=True, slots=True)
class Asked:
    """A question as SQL."""

    table: Table
    sql: str
    parameters: dict[str, Parameter]
    limit: int


@dataclass(frozen=True, slots=True)
class Dialect:
    """How an engine says what the others say otherwise."""

    day: str
    """Day of a row, counted from 1970."""
    section: str
    """Whole number below `{x}`."""


def sql_of(question: StoreQuestion, line: str) -> Asked:
    """SQL for one page and one row more, FROM `relation`; of one line alone. ValueError for a bad page."""
    table = TABLE_OF[question.about]
    conditions: list[str] = []
    parameters: dict[str, Parameter] = {}

    def add(column: str, sign: str, name: str, value: Parameter | None) -> None:
        if value is not None and value != "" and column in table.names:
            kind = _TYPES[dict(table.columns)[column]]
            conditions.append(f"{column} {sign} {{{name}:{kind}}}")
            parameters[name] = value

    add("line", "=", "line", line)
    add("taken_ns", ">=", "from_ns", question.from_ns)
    add("taken_ns", "<", "until_ns", question.until_ns)
    add("chainage_m", ">=", "from_m", question.from_chainage_m)
    add("chainage_m", "<", "until_m", question.until_chainage_m)
    add("radio", "=", "radio", question.radio)
    add("channel", "=", "channel", question.channel)
    add("place", "=", "place", f"train/{question.train}" if question.train else None)
    add("kind", "=", "kind", question.kind)
    add("topic", "=", "topic", TOPIC_OF.get(question.about, question.topic))
    add("version", "=", "version", question.model)
    add("model", "=", "model", question.model)
    if question.page:
        names = [f"last_{name}" for name in table.order]
        parameters |= dict(zip(names, _last_of(question.page, table), strict=True))
        marks = [f"{{last_{name}:{_TYPES[dict(table.columns)[name]]}}}" for name in table.order]
        conditions.append(f"({', '.join(table.order)}) > ({', '.join(marks)})")
    where = f" WHERE {' AND '.join(conditions)}" if conditions else ""
    sql = (
        f"SELECT {', '.join(table.names)} FROM relation{where} "  # noqa: S608 - names are our own, values are parameters
        f"ORDER BY {', '.join(table.order)} LIMIT {question.limit + 1}"
    )
    return Asked(table, sql, parameters, question.limit)


def learning_sql(relation: str, section_m: float, dialect: Dialect, *, day: int | None = None) -> str:
    """SQL of sums over pass values by day (counted from 1970), radio, channel, direction, cell and section.

    A pass value is the mean power of a pass over a section: passes are what varies from one to the next, samples
    within a pass hang together. Places off every line and powers that cannot be are left out, as the analysis
    leaves them out. `day`: of rows that are known to be all of one day; groups of one column less are half the work.
    """
    keys = ", ".join(SUM_KEYS[1:])
    apart, told = (f"{dialect.day} AS day, ", "day, ") if day is None else ("", "")
    section = dialect.section.format(x=f"chainage_m / {section_m!r}")
    power = "coalesce(channel_power_dbm, decoded_power_dbm)"
    passes = (
        f"SELECT {apart}radio, channel, direction, cell, {section} AS section, pass_id, avg({power}) AS v "  # noqa: S608 - names are our own
        f"FROM {relation} WHERE clock = '' AND chainage_m BETWEEN {-FARTHEST_M!r} AND {FARTHEST_M!r} "
        f"AND {power} BETWEEN {LEAST_DBM!r} AND {MOST_DBM!r} GROUP BY {told}{keys}, pass_id"
    )
    return (
        f"SELECT {'day' if day is None else f'{day:d} AS day'}, {keys}, "  # noqa: S608 - the same
        f"count(*) AS n, sum(v) AS s, sum(v * v) AS ss FROM ({passes}) AS p GROUP BY {told}{keys}"
    )


def merging_sql(relation: str, *, by_day: bool) -> str:
    """SQL that adds sums up, over days or day by day."""
    keys = ", ".join(SUM_KEYS[0 if by_day else 1 :])
    day = "" if by_day else "NULL AS day, "
    return (
        f"SELECT {day}{keys}, sum(n) AS n, sum(s) AS s, sum(ss) AS ss "  # noqa: S608 - names are our own
        f"FROM {relation} GROUP BY {keys} ORDER BY {keys}"
    )


def dollars(sql: str) -> str:
    """The same SQL with parameters in DuckDB's form.

    >>> dollars("a > {b:Int64}")
    'a > $b'
    """
    return _PARAMETER.sub(r"$\1", sql)


def literals(sql: str, parameters: dict[str, Parameter]) -> str:
    """The same SQL with parameters written out as ClickHouse's literals (older versions know no parameters)."""

    def literal(match: re.Match[str]) -> str:
        value = parameters[match.group(1)]
        if isinstance(value, str):
            return "'" + value.replace("\\", "\\\\").replace("'", "\\'").replace("\0", "") + "'"
        return repr(value)

    return _PARAMETER.sub(literal, sql)


def page_after(row: tuple[object, ...], table: Table) -> str:
    """Page that goes on behind a row of a table."""
    last = [row[table.names.index(name)] for name in table.order]
    return base64.urlsafe_b64encode(msgspec.json.encode(last)).decode()


def _last_of(page: str, table: Table) -> list[Parameter]:
    kinds = dict(table.columns)
    try:
        last = msgspec.json.decode(base64.urlsafe_b64decode(page), type=list[int | float | str])
        if [int if kinds[name] == "bigint" else str for name in table.order] == [type(value) for value in last]:
            return last
    except (ValueError, msgspec.MsgspecError):
        pass
    msg = "no page of this history: take it from the answer before"
    raise ValueError(msg)
