"""Messages made of tables: motion.csv, matches.csv, fixes.csv, balises.csv, changes.csv (docs/train_position.md).

Times count in seconds from the start of the motion log, and become nanoseconds from zero.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, get_args

import msgspec

from schemas.gnss import Fix
from schemas.gnss_time import WEEK_S
from schemas.message import Message
from schemas.motion import MotionStatus, Odometry
from schemas.position import BalisePassage, LandmarkMatch, TrainChange
from services.train_position.table_file import Row, Table, TableError, read_table

ORIGIN: Final = "log"
DEVICE: Final = "front"
STATUSES: Final[tuple[MotionStatus, ...]] = get_args(MotionStatus)


def odometry_of(path: Path, share: float) -> list[Odometry]:
    """Odometry of a motion.csv.

    The table bounds the distance from the first row alone. What its bound rises by is split into a share of the
    way, no more than `share`, and what is left, which counts as excess; a bound that falls takes nothing back.
    Raises TableError, OSError.
    """
    table = read_table(path, ("t_s", "distance_m", "speed_mps", "bound_m", "status"))
    made: list[Odometry] = []
    distance_m = way_m = excess_m = bound_m = 0.0
    for line, row in table.rows:
        before_m, distance_m = distance_m, table.number(line, row, "distance_m")
        lower_m, bound_m = bound_m, table.number(line, row, "bound_m")
        if bound_m < 0.0:
            raise TableError(path, line, f"bound_m is {bound_m}")
        moved_m = abs(distance_m - before_m) if made else 0.0
        rise_m = max(bound_m - lower_m, 0.0) if made else 0.0
        part = min(share, rise_m / moved_m) if moved_m > 0.0 else 0.0
        way_m, excess_m = way_m + moved_m, excess_m + rise_m - part * moved_m
        status = next((one for one in STATUSES if one == row["status"]), None)
        if status is None:
            raise TableError(path, line, f"status is {row['status']!r}")
        speed_mps = table.number(line, row, "speed_mps")
        made.append(
            Odometry(
                t_ns=_t_ns(table, line, row),
                method="fused",
                origin=ORIGIN,
                distance_m=distance_m,
                way_m=way_m,
                speed_mps=speed_mps,
                speed_bound_mps=0.5,
                slip=1 if (table.number_or_none(line, row, "slip") or 0.0) else 0,
                standstill=speed_mps == 0.0,
                bound_m=bound_m,
                share_bound=part,
                excess_m=excess_m,
                status=status,
                reason="" if status == "valid" else "as the table says",
            )
        )
    return made


def _t_ns(table: Table, line: int, row: Row, later_s: float = 0.0) -> int:
    return round((table.number(line, row, "t_s") + later_s) * 1e9)


def matches_of(path: Path, line_version: str) -> list[LandmarkMatch]:
    """Matches of a matches.csv; their direction follows from the correction's table where it has one, else `up`."""
    table = read_table(path, ("t_s", "landmark", "branch", "accepted", "reason", "axis_m", "bound_m"))
    return [
        LandmarkMatch(
            t_ns=_t_ns(table, line, row),
            landmark=row["landmark"],
            branch=row["branch"],
            direction="down" if row.get("direction") == "down" or row["landmark"].endswith("-down") else "up",
            accepted=True,
            reason=row["reason"],
            origin="",
            distance_m=0.0,
            axis_m=table.number(line, row, "axis_m"),
            correction_m=table.number_or_none(line, row, "correction_m") or 0.0,
            bound_m=table.number(line, row, "bound_m"),
            database_version="",
            line_version=line_version,
        )
        for line, row in table.rows
        if row["accepted"].strip() == "1"
    ]


def fixes_of(path: Path, start_gps_s: float) -> list[Fix]:
    """Fixes of a fixes.csv, with the log's start in GPS time."""
    table = read_table(path, ("gps_week", "tow_s", "status", "lat_deg", "lon_deg", "bound_m"))
    made: list[Fix] = []
    for line, row in table.rows:
        week, tow_s = table.number(line, row, "gps_week"), table.number(line, row, "tow_s")
        made.append(
            Fix(
                t_ns=round((week * WEEK_S + tow_s - start_gps_s) * 1e9),
                gps_week=int(week),
                tow_s=tow_s,
                method="robust",
                status="fix" if row["status"] == "fix" else "none",
                reason=row.get("reason", ""),
                lat_deg=table.number_or_none(line, row, "lat_deg"),
                lon_deg=table.number_or_none(line, row, "lon_deg"),
                h_m=table.number_or_none(line, row, "h_m"),
                ve_mps=table.number_or_none(line, row, "ve_mps"),
                vn_mps=table.number_or_none(line, row, "vn_mps"),
                satellites_used=0,
                satellites_flagged=0,
                bound_m=table.number_or_none(line, row, "bound_m"),
                chainage_m=table.number_or_none(line, row, "chainage_m"),
                chainage_bound_m=table.number_or_none(line, row, "chainage_bound_m"),
            )
        )
    return made


def balises_of(path: Path) -> list[BalisePassage]:
    """Passages of a balises.csv."""
    table = read_table(path, ("t_s", "balise", "sensor_offset_m", "detection_bound_m"))
    return [
        BalisePassage(
            t_ns=_t_ns(table, line, row),
            balise=row["balise"],
            sensor_offset_m=table.number(line, row, "sensor_offset_m"),
            detection_bound_m=max(table.number(line, row, "detection_bound_m"), 0.0),
        )
        for line, row in table.rows
    ]


def changes_of(path: Path) -> list[TrainChange]:
    """Changes of a changes.csv: t_s, kind, and any other fields of schemas.position.TrainChange."""
    table = read_table(path, ("t_s", "kind"))
    made: list[TrainChange] = []
    for line, row in table.rows:
        fields: dict[str, object] = {k: v for k, v in row.items() if v != "" and k != "t_s"}
        fields["t_ns"] = _t_ns(table, line, row)
        try:
            made.append(msgspec.convert(fields, TrainChange, strict=False))
        except msgspec.ValidationError as error:
            raise TableError(path, line, str(error)) from error
    return made


def ordered(arrivals: list[tuple[int, Message]]) -> list[Message]:
    """Messages in the order in which they arrive; at one time the odometry comes last, so that it answers for all."""
    return [
        message
        for _, _, _, message in sorted(
            (when_ns, isinstance(message, Odometry), number, message)
            for number, (when_ns, message) in enumerate(arrivals)
        )
    ]
