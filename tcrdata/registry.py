"""Finds datasets, cues, exporters and networks by listing a package: there is no list to edit."""

from __future__ import annotations

import importlib
import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from tcrdata.errors import SettingsError

ENTRY_FUNCTIONS = {
    "datasets": "open_dataset",
    "evidence": "run",
    "exporters": "export",
    "networks": "make_network",
}


def names(kind: str) -> list[str]:
    """Return the names of all plug-ins of a kind, sorted, without importing any of them.

    A plug-in is a module of `tcrdata.<kind>` that defines the kind's entry function, or an entry
    point of the group `tcrdata.<kind>` that another package installs.

    Args:
        kind: `datasets`, `evidence`, `exporters` or `networks`.
    """
    return sorted({*_modules(kind), *_entry_points(kind)})


def find(kind: str, name: str) -> ModuleType:
    """Return the module of a plug-in.

    Args:
        kind: `datasets`, `evidence`, `exporters` or `networks`.
        name: a name that `names(kind)` lists (a dash counts as an underscore), or the dotted
            path of a module that defines the kind's entry function.

    Raises:
        SettingsError: nothing of that name, or the module lacks the entry function.
    """
    plain = name.replace("-", "_")
    if plain in _modules(kind):
        return importlib.import_module(f"tcrdata.{kind}.{plain}")
    if plain in _entry_points(kind):
        return _checked(kind, _entry_points(kind)[plain].load())
    if "." in name:
        return _checked(kind, _import(kind, name))
    raise SettingsError(f"no {kind} named '{name}': there are {', '.join(names(kind))}")


def _import(kind: str, path: str) -> ModuleType:
    try:
        return importlib.import_module(path)
    except ModuleNotFoundError as error:
        raise SettingsError(
            f"cannot import '{path}' from {kind}: {error}; give a dotted path that Python finds"
        ) from error


def _checked(kind: str, module: ModuleType) -> ModuleType:
    function = ENTRY_FUNCTIONS[kind]
    if not callable(getattr(module, function, None)):
        raise SettingsError(
            f"{module.__name__} is no plug-in of {kind}: it defines no {function}()"
        )
    return module


@cache
def _modules(kind: str) -> frozenset[str]:
    package = importlib.util.find_spec(f"tcrdata.{kind}")
    if package is None or package.submodule_search_locations is None:
        raise SettingsError(f"'{kind}' is no kind of plug-in: {', '.join(ENTRY_FUNCTIONS)}")
    folder = Path(next(iter(package.submodule_search_locations)))
    function = ENTRY_FUNCTIONS[kind]
    return frozenset(
        path.stem
        for path in folder.glob("[a-z]*.py")
        if f"\ndef {function}(" in path.read_text(encoding="utf-8")
    )


def _entry_points(kind: str) -> dict[str, Any]:
    # Loaded where a name is none of our own.
    import importlib.metadata

    found = importlib.metadata.entry_points(group=f"tcrdata.{kind}")
    return {point.name: point for point in found}
