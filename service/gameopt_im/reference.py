"""Every key of the configuration with unit, default and range, read off the annotations of `Parameters`."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from typing import Any

import msgspec
from msgspec import inspect

from gameopt_im.core.parameters import Parameters, VehicleClass

_UNIT = re.compile(r"\s*\((?P<unit>[^()]*)\)(?=;|$)")
_INDEX = re.compile(r"\[[^\]]*\]")

_HEAD = """# Configuration

`gameopt-im serve --config im.toml` reads a TOML file with the tables below. A key left out keeps its default,
an unknown key is an error, and so is a value out of its range. Unit 1 means a plain number.

This page is generated: `python -m gameopt_im.reference > docs/configuration.md`.
"""
_CLASSES = """\
A class in the file changes only the keys it names; a new class starts as a copy of `passenger`.
"""


@dataclass(frozen=True, slots=True)
class Key:
    """One key: what stands in its row of the table."""

    name: str
    unit: str
    default: str
    range: str
    meaning: str

    def row(self) -> str:
        """The key as a row of Markdown."""
        return f"| `{self.name}` | {self.unit} | `{self.default}` | {self.range} | {self.meaning} |"


def reference() -> str:
    """The whole reference page, Markdown."""
    parts = [_HEAD]
    for table, section in _sections():
        parts.append(f"## `[{table}]`\n\n{_summary(section)}\n")
        parts.append(_table([key.row() for key in _keys(section)]))
    parts.append(f"## `[classes.NAME]`\n\n{_summary(VehicleClass)}\n{_CLASSES}")
    parts.append(_table([key.row() for key in _keys(VehicleClass)]))
    parts.append(_class_table())
    return "\n".join(parts)


def allowed(key: str) -> str:
    """What a key such as `planner.margin_s` or `auction.weights[0]` may be; for a table, its keys."""
    path = _INDEX.sub("", key).split(".")
    if path[0] == "classes":
        section: type[msgspec.Struct] | None = VehicleClass
        rest = path[2:]
    else:
        section = dict(_sections()).get(path[0])
        rest = path[1:]
    if section is None:
        return ", ".join(field.encode_name for field in msgspec.structs.fields(Parameters))
    if path == ["classes"]:
        return "one table a vehicle class, [classes.NAME]"
    keys = {row.name: row for row in _keys(section)}
    if not rest or rest[0] not in keys:
        return ", ".join(keys)
    row = keys[rest[0]]
    return row.range if row.unit == "1" else f"{row.range}, in {row.unit}"


def _sections() -> list[tuple[str, type[msgspec.Struct]]]:
    found = []
    for field in msgspec.structs.fields(Parameters):
        kind = inspect.type_info(field.type)
        if isinstance(kind, inspect.StructType):
            found.append((field.encode_name, kind.cls))
    return found


def _keys(section: type[msgspec.Struct]) -> list[Key]:
    described = inspect.type_info(section)
    if not isinstance(described, inspect.StructType):
        raise TypeError(f"{section} is not a table of the configuration")
    defaults = msgspec.to_builtins(section())
    return [_key(field, defaults[field.encode_name]) for field in described.fields]


def _key(field: inspect.Field, default: Any) -> Key:
    kind, text = field.type, ""
    if isinstance(kind, inspect.Metadata):
        text = str((kind.extra_json_schema or {}).get("description", ""))
        kind = kind.type
    unit = _UNIT.search(text)
    return Key(
        name=field.encode_name,
        unit=unit["unit"] if unit else "1",
        default=_toml(default),
        range=_range(kind),
        meaning=_UNIT.sub("", text).replace("|", "\\|"),
    )


def _toml(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def _range(kind: inspect.Type) -> str:
    """In words, so that it reads the same in the table and at the end of an error."""
    if isinstance(kind, inspect.Metadata):
        return _range(kind.type)
    if isinstance(kind, inspect.FloatType | inspect.IntType):
        noun = "a whole number" if isinstance(kind, inspect.IntType) else "a number"
        bounds = [
            f"{sign} {bound:g}"
            for sign, bound in ((">=", kind.ge), (">", kind.gt), ("<=", kind.le), ("<", kind.lt))
            if bound is not None
        ]
        return " ".join([noun, " and ".join(bounds)]).strip()
    if isinstance(kind, inspect.BoolType):
        return "true or false"
    if isinstance(kind, inspect.StrType):
        choice = re.fullmatch(r"\^\((.*)\)\$", kind.pattern or "")
        return " or ".join(f'"{word}"' for word in choice[1].split("|")) if choice else "text"
    if isinstance(kind, inspect.TupleType):
        return f"a list of {len(kind.item_types)}, each {_range(kind.item_types[0])}"
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        least, most = kind.min_length or 0, kind.max_length
        count = f"a list of {least} or more" if most is None else f"a list of {least} to {most}"
        return f"{count}, each {_range(kind.item_type)}"
    raise TypeError(f"no words for {kind}")


def _summary(section: type[msgspec.Struct]) -> str:
    return (section.__doc__ or "").strip().partition("\n")[0]


def _table(rows: list[str]) -> str:
    return "\n".join(["| key | unit | default | range | meaning |", "| --- | --- | --- | --- | --- |", *rows, ""])


def _class_table() -> str:
    """The classes that are there without a file."""
    names = [field.encode_name for field in msgspec.structs.fields(VehicleClass)]
    lines = [
        "| class | " + " | ".join(f"`{name}`" for name in names) + " |",
        "| --- |" + " --- |" * len(names),
    ]
    for name, bounds in Parameters().classes.items():
        values = msgspec.to_builtins(bounds)
        lines.append(f"| {name} | " + " | ".join(f"`{_toml(values[key])}`" for key in names) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.stdout.write(reference())
