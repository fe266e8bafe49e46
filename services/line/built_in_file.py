"""Lines that come with Kirotei, by name: `--line demo` works wherever a line file is taken."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Final

import msgspec

from schemas.line import Line
from services.line.design import LineDesign
from services.line.line_building import line_of

FOLDER: Final = "lines"


def built_in_names() -> tuple[str, ...]:
    """Names of the lines that come with Kirotei."""
    folder = files("services.line") / FOLDER
    return tuple(sorted(one.name.removesuffix(".toml") for one in folder.iterdir() if one.name.endswith(".toml")))


@cache
def built_in_line(name: str) -> Line:
    """The line of a design in this package, built once per process. Raises KeyError for an unknown name."""
    if name not in built_in_names():
        msg = f"no line named {name!r} comes with Kirotei; these do: {', '.join(built_in_names())}"
        raise KeyError(msg)
    design = files("services.line") / FOLDER / f"{name}.toml"
    return line_of(msgspec.toml.decode(design.read_bytes(), type=LineDesign))
