"""Reports as lines of text: CSV with a header, and JSON objects."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

LONGEST: Final = 16_384
"""Characters of a line; what is longer is no report."""
Row = Mapping[str, Any]


class Lines:
    """Cuts bytes into lines; a line that does not end is thrown away once it is too long."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._rest = b""
        self._skipping = False
        self.too_long = 0

    def feed(self, chunk: bytes) -> list[str]:
        """Lines that the bytes complete, without blank ones; bytes that are no UTF-8 are replaced."""
        *lines, rest = (self._rest + chunk).split(b"\n")
        if self._skipping and lines:
            lines, self._skipping = lines[1:], False
        if len(rest) > LONGEST or self._skipping:
            self.too_long += not self._skipping
            self._skipping, rest = True, b""
        self._rest = rest
        texts = [line.decode("utf-8", "replace").strip() for line in lines]
        self.too_long += sum(len(text) > LONGEST for text in texts)
        return [text for text in texts if text and len(text) <= LONGEST]


class CsvRows:
    """Lines of CSV; the first one names the columns unless they are known, and may come again."""

    def __init__(self, columns: Sequence[str] = ()) -> None:
        """Know the columns, or wait for them."""
        self._columns = tuple(columns)
        self._known = bool(columns)

    def row(self, line: str) -> Row | str:
        """Cells by column, blank ones left out; words for a line that cannot be used, empty for a header."""
        try:
            cells = [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True), [])]
        except csv.Error as error:
            return f"no CSV: {error}"
        if not self._known:
            if len(set(cells)) < len(cells) or not all(cells):
                return "the first line names no columns"
            self._columns, self._known = tuple(cells), True
            return ""
        if tuple(cells) == self._columns:
            return ""
        if len(cells) != len(self._columns):
            return f"{len(cells)} cells for {len(self._columns)} columns"
        return {name: cell for name, cell in zip(self._columns, cells, strict=True) if cell}


class JsonRows:
    """One JSON object a line."""

    def row(self, line: str) -> Row | str:
        """Its members, nulls left out; words for a line that is none."""
        try:
            found = msgspec.json.decode(line)
        except (msgspec.DecodeError, RecursionError) as error:
            return f"no JSON: {error}"
        if not isinstance(found, dict):
            return "no JSON object"
        return {str(name): value for name, value in found.items() if value is not None}
