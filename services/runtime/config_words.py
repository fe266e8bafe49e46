"""Configuration structs in words: types, limits, defaults and what the fields mean."""

from __future__ import annotations

import ast
import inspect
import itertools
import json
import textwrap
from dataclasses import dataclass
from typing import Any

import msgspec
from msgspec import inspect as types


@dataclass(frozen=True, slots=True)
class FieldRow:
    """One setting, in words."""

    name: str
    """Path within its table, 'weights.elevation'."""
    type: str
    limits: str
    default: str
    about: str


def words_of(wanted: Any) -> str:  # noqa: ANN401 - any type
    """Type and limits in words.

    >>> words_of(int | None)
    'int, or nothing'
    """
    return _joined(types.type_info(wanted))


def _words(node: types.Type) -> tuple[str, str]:
    """Type and limits."""
    return _scalar_words(node) or _container_words(node) or (type(node).__name__.removesuffix("Type").lower(), "")


def _scalar_words(node: types.Type) -> tuple[str, str] | None:
    match node:
        case types.IntType() | types.FloatType():
            return ("int" if isinstance(node, types.IntType) else "float"), _range(node)
        case types.StrType(pattern=pattern):
            return "string", f"matching {pattern}" if pattern else _length(node, "characters")
        case types.BoolType():
            return "true or false", ""
        case types.LiteralType(values=values):
            return f"one of {', '.join(str(value) for value in values)}", ""
        case types.EnumType(cls=cls):
            return f"one of {', '.join(str(member.value) for member in cls)}", ""
    return None


def _container_words(node: types.Type) -> tuple[str, str] | None:
    match node:
        case types.VarTupleType(item_type=item) | types.ListType(item_type=item):
            return f"list of {_joined(item)}", _length(node, "entries")
        case types.TupleType(item_types=items):
            return f"[{', '.join(map(_joined, items))}]", ""
        case types.DictType(value_type=value):
            return f"table of {_joined(value)}", ""
        case types.StructType():
            return "table", ""
        case types.UnionType(types=arms):
            parts = [_joined(arm) for arm in arms if not isinstance(arm, types.NoneType)]
            return f"{' or '.join(parts)}{', or nothing' if len(parts) < len(arms) else ''}", ""
    return None


def _joined(node: types.Type) -> str:
    return " ".join(_words(node)).strip()


def _range(node: types.IntType | types.FloatType) -> str:
    limits = ((">", node.gt), (">=", node.ge), ("<", node.lt), ("<=", node.le))
    parts = [f"{sign} {limit:g}" for sign, limit in limits if limit is not None]
    if node.multiple_of is not None:
        parts.append(f"multiple of {node.multiple_of:g}")
    return " and ".join(parts)


def _length(node: types.StrType | types.VarTupleType | types.ListType, what: str) -> str:
    parts = []
    if node.min_length is not None:
        parts.append(f"at least {node.min_length}")
    if node.max_length is not None:
        parts.append(f"at most {node.max_length}")
    return f"({' and '.join(parts)} {what})" if parts else ""


def field_rows(struct: type[msgspec.Struct], prefix: str = "") -> list[FieldRow]:
    """Every setting of a struct, inner tables unfolded."""
    about = field_docs(struct)
    rows = []
    for entry in msgspec.structs.fields(struct):
        name = prefix + entry.encode_name
        node = types.type_info(entry.type)
        words, limits = _words(node)
        if isinstance(node, types.StructType) and issubclass(node.cls, msgspec.Struct):
            rows += field_rows(node.cls, f"{name}.")
            continue
        rows.append(FieldRow(name, words, limits, _default(entry), about.get(entry.name, "")))
    return rows


def _default(entry: msgspec.structs.FieldInfo) -> str:
    if entry.required:
        return "required"
    value = default_of(entry)
    return "nothing" if value is None else as_toml(value)


def default_of(entry: msgspec.structs.FieldInfo) -> Any:  # noqa: ANN401 - any field
    """Value that a field has when nothing is given; NODEFAULT for a required one."""
    if entry.default_factory is not msgspec.NODEFAULT:
        return entry.default_factory()
    return entry.default


def as_toml(value: object) -> str:
    """Value as it would stand in a profile (JSON's spelling, which TOML shares for these)."""
    return json.dumps(msgspec.to_builtins(value), ensure_ascii=False)


def field_docs(struct: type) -> dict[str, str]:
    """What the string under each field says, read from the source; inherited fields included.

    Fields of a struct whose source is not at hand have none.
    """
    docs: dict[str, str] = {}
    for cls in reversed(struct.__mro__):
        if cls.__module__ in ("builtins", "msgspec", "msgspec._core"):
            continue
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(cls)))
        except (OSError, TypeError, SyntaxError):
            continue
        body = tree.body[0].body if tree.body and isinstance(tree.body[0], ast.ClassDef) else []
        for statement, below in itertools.pairwise(body):
            if (
                isinstance(statement, ast.AnnAssign)
                and isinstance(statement.target, ast.Name)
                and isinstance(below, ast.Expr)
                and isinstance(below.value, ast.Constant)
                and isinstance(below.value.value, str)
            ):
                docs[statement.target.id] = " ".join(below.value.value.split())
    return docs


def config_table(struct: type[msgspec.Struct]) -> str:
    """Markdown table of a struct's settings, for the documentation."""
    lines = ["| setting | type | limits | default | meaning |", "|---|---|---|---|---|"]
    for row in field_rows(struct):
        cells = (f"`{row.name}`", row.type, row.limits, f"`{row.default}`", row.about)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)


def differences(value: msgspec.Struct, prefix: str = "") -> list[tuple[str, str, str]]:
    """Settings that are not at their default, as (path, value, default or 'required')."""
    found = []
    for entry in msgspec.structs.fields(value):
        now = getattr(value, entry.name)
        default = default_of(entry)
        name = prefix + entry.encode_name
        if isinstance(now, msgspec.Struct) and (entry.required or isinstance(default, type(now))):
            found += differences(now, f"{name}.")
        elif entry.required or now != default:
            found.append((name, as_toml(now), "required" if entry.required else as_toml(default)))
    return found
