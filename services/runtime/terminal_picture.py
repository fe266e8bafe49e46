"""A terminal view as an SVG picture that asks no other host for a font."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console, RenderableType

# Places in braces are Rich's (Console.export_svg).
_PAGE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">
<style>
.{unique_id}-matrix {{ font: {char_height}px "DejaVu Sans Mono", Menlo, Consolas, monospace; }}
.{unique_id}-title {{ font: bold 18px sans-serif; }}
{styles}
</style>
<defs><clipPath id="{unique_id}-clip-terminal"><rect width="{terminal_width}" height="{terminal_height}"/></clipPath>
{lines}</defs>
{chrome}
<g transform="translate({terminal_x}, {terminal_y})" clip-path="url(#{unique_id}-clip-terminal)">
{backgrounds}
<g class="{unique_id}-matrix">{matrix}</g>
</g>
</svg>
"""
COLUMNS = 132


def save_picture(view: RenderableType, title: str, path: Path) -> None:
    """Draw a view as it would look on a wide terminal. Raises OSError."""
    console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True, color_system="truecolor")
    console.print(view)
    path.write_text(console.export_svg(title=title, code_format=_PAGE, unique_id="view"), "utf-8")
