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
from services.cloud_analyzer.tables import EVENTS, RADIO, Table

ORDER: Final = ("taken_ns", "key", "boot_id", "sequence")
_PARAMETER = re.compile(r"\{(\w+):\w+\}")
SUM_KEYS: Final = ("day", "radio", "channel", "direction", "cell", "section")
Parameter = str | int | float


@dataclass(frozen=True, slots=True)
class Asked:
    """A question as SQL."""

    table: Table
    columns: tuple[str, ...]
    sql: str
    parameters: dict[str, Parameter]
    limit: int


def sql_of(question: StoreQuestion, relation: str) -> Asked:
    """SQL for one page and one row more; `relation` is what stands behind FROM. ValueError for a bad page."""
    table = RADIO if question.about == "radio" else EVENTS
    columns = table.names
    conditions: list[str] = []
    parameters: dict[str, Parameter] = {}

    def add(condition: str, name: str, value: Parameter | None) -> None:
        if value is not None and value != "":
            conditions.append(condition)
            parameters[name] = value

    add("taken_ns >= {from_ns:Int64}", "from_ns", question.from_ns)
    add("taken_ns < {until_ns:Int64}", "until_ns", question.until_ns)
    add("chainage_m >= {from_m:Float64}", "from_m", question.from_chainage_m)
    add("chainage_m < {until_m:Float64}", "until_m", question.until_chainage_m)
    add("radio = {radio:String}", "radio", question.radio)
    add("channel = {channel:String}", "channel", question.channel)
    add("place = {place:String}", "place", f"train/{question.train}" if question.train else None)
    if table is EVENTS:
        add("kind = {kind:String}", "kind", question.kind)
    if question.about == "radio_events":
        add("topic = {topic:String}", "topic", "radio/event")
    if question.page:
        last_ns, last_key, last_boot, last_number = _last_of(question.page)
        parameters |= {"last_taken_ns": last_ns, "last_key": last_key}
        parameters |= {"last_boot_id": last_boot, "last_sequence": last_number}
        conditions.append(
            "(taken_ns, key, boot_id, sequence) > "
            "({last_taken_ns:Int64}, {last_key:String}, {last_boot_id:String}, {last_sequence:Int64})"
        )
    where = f" WHERE {' AND '.join(conditions)}" if conditions else ""
    sql = (
        f"SELECT {', '.join(columns)} FROM {relation}{where} "  # noqa: S608 - names are our own, values are parameters
        f"ORDER BY {', '.join(ORDER)} LIMIT {question.limit + 1}"
    )
    return Asked(table, columns, sql, parameters, question.limit)


def learning_sql(relation: str, section_m: float, *, whole: str) -> str:
    """SQL of sums over pass values by day (counted from 1970), radio, channel, direction, cell and section.

    A pass value is the mean power of a pass over a section: passes are what varies from one to the next, samples
    within a pass hang together. `whole`: the engine's own floor to a 64-bit number, with `{x}` for what is floored.
    """
    day = whole.format(x="taken_ns / 86400000000000")
    section = whole.format(x=f"chainage_m / {section_m!r}")
    keys = ", ".join(SUM_KEYS)
    power = "coalesce(channel_power_dbm, decoded_power_dbm)"
    passes = (
        f"SELECT {day} AS day, radio, channel, direction, cell, {section} AS section, pass_id, avg({power}) AS v "  # noqa: S608 - names are our own
        f"FROM {relation} WHERE chainage_m IS NOT NULL AND {power} IS NOT NULL AND clock = '' "
        f"GROUP BY {keys}, pass_id"
    )
    return f"SELECT {keys}, count(*) AS n, sum(v) AS s, sum(v * v) AS ss FROM ({passes}) AS p GROUP BY {keys}"  # noqa: S608 - the same


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


def page_after(row: tuple[object, ...], columns: tuple[str, ...]) -> str:
    """Page that goes on behind a row."""
    last = [row[columns.index(name)] for name in ORDER]
    return base64.urlsafe_b64encode(msgspec.json.encode(last)).decode()


def _last_of(page: str) -> tuple[int, str, str, int]:
    try:
        return msgspec.json.decode(base64.urlsafe_b64decode(page), type=tuple[int, str, str, int])
    except (ValueError, msgspec.MsgspecError) as error:
        msg = "no page of this history: take it from the answer before"
        raise ValueError(msg) from error
