"""Small RINEX texts, written line by line, and what they say, for the readers' tests."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from services.gnss_receiver.observations import Observations, satellite_name

Key = tuple[int, float, str, str]
"""GPS week, time of week, satellite, signal."""
Figures = tuple[float | None, float | None, float | None, float | None]
"""Pseudorange, carrier phase, Doppler, strength; None where there is none."""

TIMES = ((11, 10, 41.7), (11, 10, 42.0), (11, 10, 42.2), (11, 10, 42.4))
WEEK, FIRST_TOW_S = 1900, 126641.7
SATELLITES = ("G12", "R20", "E05", "G19")
MANY = tuple(f"G{number:02d}" for number in range(1, 15))
TYPES_2 = ("C1", "L1", "S1", "D1")
TYPES_3 = ("C1C", "L1C", "S1C", "D1C")


def header_line(content: str, label: str) -> str:
    return f"{content:60}{label}"


def value_of(epoch: int, satellite: int, column: int) -> float:
    """A figure of its own for every place, exact in three decimals."""
    base = (20_000_000.0, 105_000_000.0, 40.0, -2500.0)[column % 4]
    return base + 1000 * epoch + 10 * satellite + (column // 4) * 0.5 + (0.125 if column % 4 < 2 else 0.0)


def field(value: float | None, lost: str = " ") -> str:
    return " " * 16 if value is None else f"{value:14.3f}{lost} "


def header_2(types: Sequence[str] = TYPES_2, system: str = "M", version: str = "2.11", time: str = "GPS") -> list[str]:
    lines = [header_line(f"{version:>9}{'':11}{'OBSERVATION DATA':20}{system}", "RINEX VERSION / TYPE")]
    for at in range(0, len(types), 9):
        count = f"{len(types):6d}" if at == 0 else " " * 6
        codes = "".join(f"    {code}" for code in types[at : at + 9])
        lines.append(header_line(count + codes, "# / TYPES OF OBSERV"))
    lines.append(header_line(f"  2016     6     6    11    10   41.7000000     {time}", "TIME OF FIRST OBS"))
    return [*lines, header_line("", "END OF HEADER")]


def header_3(
    types: Mapping[str, Sequence[str]] | None = None, system: str = "M", version: str = "3.04", time: str = "GPS"
) -> list[str]:
    lines = [header_line(f"{version:>9}{'':11}{'OBSERVATION DATA':20}{system}", "RINEX VERSION / TYPE")]
    for letter, codes in (types or dict.fromkeys("GRE", TYPES_3)).items():
        for at in range(0, len(codes), 13):
            start = f"{letter}  {len(codes):3d}" if at == 0 else " " * 6
            lines.append(
                header_line(start + "".join(f" {code:3}" for code in codes[at : at + 13]), "SYS / # / OBS TYPES")
            )
    lines.append(header_line(f"  2016    06    06    11    10   41.7000000     {time}", "TIME OF FIRST OBS"))
    return [*lines, header_line("", "END OF HEADER")]


def epoch_2(index: int, satellites: Sequence[str] = SATELLITES, columns: int = 4, flag: int = 0) -> list[str]:
    hour, minute, second = TIMES[index % len(TIMES)]
    head = f" 16  6  6 {hour:2d} {minute:2d} {second:10.7f}  {flag}{len(satellites):3d}"
    lines = [f"{head[:15]}{second:11.7f}  {flag}{len(satellites):3d}" + "".join(satellites[:12])]
    lines += [" " * 32 + "".join(satellites[at : at + 12]) for at in range(12, len(satellites), 12)]
    for place in range(len(satellites)):
        fields = [field(value_of(index, place, column)) for column in range(columns)]
        lines += ["".join(fields[at : at + 5]).rstrip() for at in range(0, columns, 5)]
    return lines


def epoch_3(index: int, satellites: Sequence[str] = SATELLITES, columns: int = 4, flag: int = 0) -> list[str]:
    hour, minute, second = TIMES[index % len(TIMES)]
    lines = [f"> 2016 06 06 {hour:2d} {minute:2d}{second:11.7f}  {flag}{len(satellites):3d}"]
    for place, satellite in enumerate(satellites):
        lines.append(satellite + "".join(field(value_of(index, place, column)) for column in range(columns)).rstrip())
    return lines


def text_of(*parts: Iterable[str]) -> bytes:
    return "".join(f"{line}\n" for part in parts for line in part).encode("ascii")


def rows_of(observations: Observations) -> dict[Key, Figures]:
    """Every row by epoch, satellite and signal; repeated epochs must not occur."""
    found: dict[Key, Figures] = {}
    for epoch in range(len(observations)):
        for row in range(int(observations.first_row[epoch]), int(observations.first_row[epoch + 1])):
            key = (
                int(observations.gps_week[epoch]),
                float(observations.tow_s[epoch]),
                satellite_name(int(observations.satellite[row])),
                observations.signals[int(observations.signal[row])],
            )
            assert key not in found
            found[key] = tuple(  # type: ignore[assignment]  # four columns
                None if math.isnan(value) else value
                for value in (
                    float(column[row])
                    for column in (
                        observations.pseudorange_m,
                        observations.carrier_phase_cycles,
                        observations.doppler_hz,
                        observations.cn0_dbhz,
                    )
                )
            )
    return found


def expected(epochs: int, satellites: Sequence[str] = SATELLITES, signal: str = "1C") -> dict[Key, Figures]:
    """What `epoch_2` and `epoch_3` with four columns (C, L, S, D) say."""
    found: dict[Key, Figures] = {}
    for index in range(epochs):
        for place, satellite in enumerate(satellites):
            c, phase, s, d = (value_of(index, place, column) for column in range(4))
            found[WEEK, tow_s(index), satellite, signal] = (c, phase, d, s)
    return found


def tow_s(index: int) -> float:
    hour, minute, second = TIMES[index]
    return round(86_400 + 3600 * hour + 60 * minute + second, 7)
