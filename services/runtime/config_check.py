"""Tables of a configuration checked against the struct that they must fit, every fault by its path."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import msgspec

from services.runtime.catalogue import suggestion
from services.runtime.config_words import words_of

S = TypeVar("S", bound=msgspec.Struct)
SHOWN_CHARACTERS = 60


@dataclass(slots=True)
class Faults:
    """What is wrong, as (path of the field, words)."""

    found: list[tuple[tuple[str, ...], str]] = field(default_factory=list)

    def add(self, path: tuple[str, ...], words: str) -> None:
        """Note one fault."""
        self.found.append((path, words))


def converted(table: Mapping[str, object], struct: type[S], faults: Faults, path: tuple[str, ...] = ()) -> S | None:
    """Struct that `table` gives; None, with every fault noted, when it does not fit.

    Unknown fields, missing fields, wrong types, values out of range and numbers that are
    not finite are faults, also in structs that would themselves accept them.
    """
    before = len(faults.found)
    _check_struct(table, struct, path, faults)
    if len(faults.found) > before:
        return None
    settled: S | None = _try_convert(table, struct, path, faults)
    return settled


def _try_convert(value: object, wanted: Any, path: tuple[str, ...], faults: Faults) -> Any:  # noqa: ANN401 - any type
    try:
        return msgspec.convert(value, wanted)
    except msgspec.ValidationError as error:
        told = str(error).partition(" - at `$")[0]
        generic = told.startswith(("Expected `", "Invalid ", "Object "))
        faults.add(path, f"expected {words_of(wanted)}, got {shown(value)}" if generic else told)
    return None


def _check_struct(table: Mapping[str, object], struct: type[msgspec.Struct], path: tuple[str, ...], f: Faults) -> None:
    fields = {entry.encode_name: entry for entry in msgspec.structs.fields(struct)}
    for name, value in table.items():
        if name in fields:
            _check(value, fields[name].type, (*path, name), f)
        else:
            f.add((*path, name), f"unknown field{suggestion(name, fields)}")
    for name, entry in fields.items():
        if entry.required and name not in table:
            f.add((*path, name), f"missing: expected {words_of(entry.type)}")


def _check(value: object, wanted: Any, path: tuple[str, ...], faults: Faults) -> None:  # noqa: ANN401 - any type
    """Check inner parts first, so that faults carry the innermost path; then the whole."""
    before = len(faults.found)
    inner = bare(wanted)
    struct = struct_of(inner)
    arguments = get_args(inner)
    if struct is not None and isinstance(value, Mapping):
        _check_struct(value, struct, path, faults)
    elif isinstance(value, list) and get_origin(inner) in (tuple, list) and arguments[-1:] != ():
        every = arguments[0] if get_origin(inner) is list or arguments[-1] is Ellipsis else None
        for index, item in enumerate(value):
            part = every if every is not None else arguments[min(index, len(arguments) - 1)]
            _check(item, part, (*path[:-1], f"{path[-1]}[{index}]"), faults)
    elif isinstance(value, Mapping) and get_origin(inner) is dict:
        for name, item in value.items():
            _check(item, arguments[1], (*path, str(name)), faults)
    elif isinstance(value, float) and not math.isfinite(value):
        faults.add(path, f"expected a finite number, got {shown(value)}")
    if len(faults.found) == before:
        _try_convert(value, wanted, path, faults)


def bare(wanted: Any) -> Any:  # noqa: ANN401 - any type
    """Type without its `Annotated` limits."""
    return get_args(wanted)[0] if get_origin(wanted) is Annotated else wanted


def struct_of(wanted: Any) -> type[msgspec.Struct] | None:  # noqa: ANN401 - any type
    """Struct that a table for this type must fit: the type itself, or the only struct of a union."""
    if isinstance(wanted, type) and issubclass(wanted, msgspec.Struct):
        return wanted
    if get_origin(wanted) in (Union, UnionType):
        arms = [arm for arm in map(bare, get_args(wanted)) if isinstance(arm, type) and issubclass(arm, msgspec.Struct)]
        return arms[0] if len(arms) == 1 else None
    return None


def shown(value: object) -> str:
    """Value as a person may have typed it, cut when long."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except (TypeError, ValueError):
        text = str(value)
    return text if len(text) <= SHOWN_CHARACTERS else f"{text[: SHOWN_CHARACTERS - 1]}…"
