"""telegrams.csv and bits.csv. Written beside their places, then renamed."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from services.track_circuit.circuit_reception import Received, Row

COLUMNS: Final = ("t_s", "circuit", "sequence", "payload_hex", "crc_ok", "evm_db", "level_db", "state")
CODED: Final = ("carrier_hz", "code_hz", "margin_db", "meaning")
"""Further columns of frequency-coded circuits."""
BITS: Final = ("symbol", "bit", "soft")


def _text(value: float | None, places: int) -> str:
    return "" if value is None else f"{value:.{places}f}"


def _cells(row: Row, *, coded: bool) -> list[str]:
    cells = [
        f"{row.t_s:.6f}",
        row.circuit,
        "" if row.sequence is None else str(row.sequence),
        row.payload.hex(),
        "1" if row.crc_ok else "0",
        _text(row.evm_db, 2),
        f"{row.level_db:.2f}",
        row.state,
    ]
    if coded:
        cells += [_text(row.carrier_hz, 2), _text(row.code_hz, 2), _text(row.margin_db, 1), row.meaning]
    return cells


def _write(path: Path, header: tuple[str, ...], lines: Iterable[list[str]]) -> None:
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(header)
            table.writerows(lines)
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_telegrams(path: Path, rows: list[Row], *, coded: bool) -> None:
    """One line per telegram, or per window of a frequency-coded circuit. Raises OSError."""
    _write(path, COLUMNS + (CODED if coded else ()), (_cells(row, coded=coded) for row in rows))


def write_bits(path: Path, received: Received) -> None:
    """One line per symbol: its number, the bit, the soft value (+1 is a perfect 0). Raises OSError."""

    def lines() -> Iterable[list[str]]:
        for symbol, bit, soft in zip(received.symbol, received.bit, received.soft, strict=True):
            for s, b, v in zip(symbol.tolist(), bit.tolist(), soft.tolist(), strict=True):
                yield [str(s), str(b), f"{v:.4f}"]

    _write(path, BITS, lines())
