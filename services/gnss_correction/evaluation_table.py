"""Evaluations as tables of plain text, the methods side by side, in the order of Yoshinaga et al. 2008."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from services.gnss_correction.along_track import AlongError
from services.gnss_correction.evaluation import Evaluation

_Figure = Callable[[Evaluation], str]


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _table(title: str, evaluations: Sequence[Evaluation], rows: Sequence[tuple[str, _Figure]]) -> str:
    """Lines of one table: a row per figure, a column per method."""
    cells = [["", *(one.name for one in evaluations)]]
    cells += [[label, *(figure(one) for one in evaluations)] for label, figure in rows]
    return _laid_out(title, cells)


def _laid_out(title: str, cells: Sequence[Sequence[str]]) -> str:
    """A title over columns: the first to the left, the others to the right."""
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    lines = [title]
    for row in cells:
        first, *others = (
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append("  ".join((first, *others)).rstrip())
    lines.insert(2, "-" * (sum(widths) + 2 * (len(widths) - 1)))
    return "\n".join(lines)


def line_table(evaluations: Sequence[Evaluation]) -> str:
    """The paper's Table 1."""
    return _table(
        "Table 1: distance to the line [m]",
        evaluations,
        (
            ("average", lambda one: _metres(one.line.average_m if one.line else None)),
            ("maximum", lambda one: _metres(one.line.maximum_m if one.line else None)),
            ("minimum", lambda one: _metres(one.line.minimum_m if one.line else None)),
            ("standard deviation", lambda one: _metres(one.line.standard_deviation_m if one.line else None)),
        ),
    )


def fixation_table(evaluations: Sequence[Evaluation]) -> str:
    """The paper's Table 2."""
    return _table(
        "Table 2: fixation rate",
        evaluations,
        (
            ("epochs", lambda one: str(one.epochs)),
            ("with a fix [%]", lambda one: f"{one.fixation_percent:.3f}"),
        ),
    )


def truth_table(evaluations: Sequence[Evaluation]) -> str:
    """Horizontal error against the truth."""
    return _table(
        "Horizontal error against the truth [m]",
        evaluations,
        (
            ("epochs inside the truth", lambda one: str(one.truth.epochs) if one.truth else "-"),
            ("with a fix [%]", lambda one: f"{one.truth.fixation_percent:.3f}" if one.truth else "-"),
            ("mean", lambda one: _metres(one.truth.mean_m if one.truth else None)),
            ("50 %", lambda one: _metres(one.truth.p50_m if one.truth else None)),
            ("95 %", lambda one: _metres(one.truth.p95_m if one.truth else None)),
            ("maximum", lambda one: _metres(one.truth.maximum_m if one.truth else None)),
        ),
    )


def along_table(results: Sequence[tuple[str, AlongError | None]]) -> str:
    """Error of the chainage against the truth."""
    cells: list[tuple[str, Callable[[AlongError], str]]] = [
        ("with a chainage [%]", lambda one: f"{one.known_percent:.3f}"),
        ("mean", lambda one: _metres(one.mean_m)),
        ("95 %", lambda one: _metres(one.p95_m)),
        ("maximum", lambda one: _metres(one.maximum_m)),
        ("median bound", lambda one: _metres(one.bound_p50_m)),
        ("epochs beyond their bound", lambda one: str(one.beyond_bound)),
    ]
    rows = [["", *(name for name, _ in results)]]
    rows += [[label, *("-" if one is None else figure(one) for _, one in results)] for label, figure in cells]
    return _laid_out("Error along the line against the truth [m]", rows)


def tables(evaluations: Sequence[Evaluation], *, with_line: bool, with_truth: bool) -> str:
    """All tables for which there is something to compare with."""
    parts = [line_table(evaluations)] if with_line else []
    parts.append(fixation_table(evaluations))
    if with_truth:
        parts.append(truth_table(evaluations))
    return "\n\n".join(parts)
