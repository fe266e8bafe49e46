"""A report as one HTML page without anything outside of it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import escape

from services.run_history.report_blocks import Block
from services.run_history.report_tables import Table
from services.run_history.report_words import Language, said

STYLE = """
body { font: 15px/1.5 sans-serif; color: #1a1a1a; background: #fff; }
body { max-width: 76rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; font-size: .85rem; margin: .6rem 0; }
th, td { border-bottom: 1px solid #ddd; padding: .25rem .6rem; text-align: left; }
th { background: #f3f3f3; }
div.wide { overflow-x: auto; }
div.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(20rem, 1fr)); gap: 0 2rem; }
p { margin: .4rem 0; } h3 { font-size: 1rem; }
figure { margin: 1rem 0; } figure svg { width: 100%; height: auto; }
figcaption { font-size: .85rem; color: #555; }
@media print { h2 { break-after: avoid; } figure, table { break-inside: avoid; } }
"""


def page(blocks: Iterable[tuple[Block, str]], language: Language) -> str:
    """HTML of blocks with the SVG of their pictures (empty for others)."""
    body = "\n".join(_block(block, svg, number) for number, (block, svg) in enumerate(blocks))
    return (
        f'<!doctype html>\n<html lang="{language}">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(said('title', language))}</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


def _block(block: Block, svg: str, number: int) -> str:
    if block.heading:
        return f"<h{block.level}>{escape(block.heading)}</h{block.level}>"
    if block.table is not None:
        return _table(block.table)
    if block.picture is not None:
        caption = escape(block.caption)
        return (
            f'<figure role="img" aria-label="{caption}">{_own(svg, number)}<figcaption>{caption}</figcaption></figure>'
        )
    columns = [column for column in (block.lines, block.beside) if column]
    texts = ["".join(f"<p>{escape(line)}</p>" for line in column) for column in columns]
    return (
        texts[0] if len(texts) == 1 else "".join(("<div class=two>", *(f"<div>{one}</div>" for one in texts), "</div>"))
    )


def _table(table: Table) -> str:
    heads = "".join(f"<th>{escape(head)}</th>" for head in table.heads)
    rows = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>\n" for row in table.rows)
    return f'<div class="wide"><table><thead><tr>{heads}</tr></thead>\n<tbody>{rows}</tbody></table></div>'


def _own(svg: str, number: int) -> str:
    """The SVG element alone, its ids its own: several pictures stand in one page."""
    element = svg[svg.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    element = re.sub(r'\bid="([^"]+)"', rf'id="p{number}-\1"', element)
    element = re.sub(r"url\(#([^)]+)\)", rf"url(#p{number}-\1)", element)
    return re.sub(r'href="#([^"]+)"', rf'href="#p{number}-\1"', element)
