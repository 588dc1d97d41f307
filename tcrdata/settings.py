"""Settings: frozen dataclasses, overridden by TOML and `--set a.b=c`, and their hash."""

from __future__ import annotations

import dataclasses
import difflib
import hashlib
import json
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tcrdata.errors import SettingsError

S = TypeVar("S")


def parse_assignments(assignments: list[str]) -> dict[str, str]:
    """Return `{"a.b": "c"}` from `["a.b=c"]`.

    Raises:
        SettingsError: an assignment without a name or an equals sign.
    """
    parsed: dict[str, str] = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise SettingsError(f"'{text}' is no setting: write NAME=VALUE")
        parsed[name.strip()] = value.strip()
    return parsed


def read_toml(path: str) -> dict[str, str]:
    """Return a TOML file as flat assignments, `{"free_space.margin_m": "0.3"}`.

    Raises:
        SettingsError: the file is missing or is no TOML.
    """
    import tomllib

    try:
        tree = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SettingsError(f"cannot read settings from {path}: {error}") from error
    return dict(_flatten("", tree))


def _flatten(prefix: str, tree: Mapping[str, Any]) -> typing.Iterator[tuple[str, str]]:
    for key, value in tree.items():
        name = f"{prefix}.{key}" if prefix else key
        if isinstance(value, Mapping):
            yield from _flatten(name, value)
        else:
            yield name, value if isinstance(value, str) else json.dumps(value)


def overridden(settings: S, values: Mapping[str, str], where: str) -> S:
    """Return the settings with fields replaced by values parsed to each field's type.

    Args:
        settings: a frozen dataclass of numbers, booleans, strings and tuples of them.
        values: field name to text.
        where: prefix of the names in messages, such as `free_space`.

    Raises:
        SettingsError: an unknown field (near names are listed) or a value of the wrong type.
    """
    types = typing.get_type_hints(type(settings))
    fields = [field.name for field in dataclasses.fields(settings)]  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    for name, text in values.items():
        if name not in fields:
            raise SettingsError(unknown(f"setting '{where}.{name}'", name, fields))
        changes[name] = _parsed(text, types[name], f"{where}.{name}")
    return dataclasses.replace(settings, **changes)  # type: ignore[type-var]


def unknown(what: str, name: str, known: typing.Iterable[str]) -> str:
    """Return a message for an unknown name that lists the nearest known ones, else all."""
    choices = sorted(known)
    near = difflib.get_close_matches(name, choices, n=3, cutoff=0.5)
    return f"unknown {what}: {'did you mean' if near else 'there are'} {', '.join(near or choices)}"


def as_plain(settings: Any) -> Any:
    """Return a dataclass as plain dicts, lists, numbers and strings, ready for JSON."""
    if dataclasses.is_dataclass(settings) and not isinstance(settings, type):
        return {f.name: as_plain(getattr(settings, f.name)) for f in dataclasses.fields(settings)}
    if isinstance(settings, list | tuple):
        return [as_plain(value) for value in settings]
    return settings


def digest(value: Any) -> str:
    """Return the sha256 (hex) of a JSON-able value, the same on every machine."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _parsed(text: str, kind: Any, where: str) -> Any:
    if typing.get_origin(kind) is tuple:
        inner = typing.get_args(kind)[0]
        parts = [part for part in text.strip("()[] ").split(",") if part.strip()]
        return tuple(_parsed(part.strip(), inner, where) for part in parts)
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise SettingsError(f"{where}: '{text}' is neither true nor false")
        return text.lower() == "true"
    if kind in (int, float):
        try:
            return kind(text)
        except ValueError as error:
            raise SettingsError(f"{where}: '{text}' is no {kind.__name__}") from error
    return text.strip("'\"")


def grouped(assignments: Mapping[str, str], groups: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return assignments by the group before their dot; those without one under "".

    Args:
        assignments: name, or group.name, to text.
        groups: that there are; each has an entry, and so has "".

    Raises:
        SettingsError: an unknown group.
    """
    found: dict[str, dict[str, str]] = {name: {} for name in ("", *groups)}
    for name, text in assignments.items():
        group, dot, attribute = name.partition(".")
        if dot and group not in groups:
            raise SettingsError(unknown(f"group '{group}' in '{name}'", group, groups))
        found[group if dot else ""][attribute if dot else name] = text
    return found
