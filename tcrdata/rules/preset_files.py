"""Reads presets from their files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from tcrdata.errors import RuleError, SettingsError
from tcrdata.resources import resource_files, resource_folder
from tcrdata.rules.binding import PRESET_COLUMNS, Binder
from tcrdata.rules.parameters import Parameter
from tcrdata.rules.presets import FOLLOWS, LOOSENED, NEXT, Preset
from tcrdata.rules.rule_files import (
    Rule,
    RuleText,
    check_described,
    check_unique,
    load_rules,
    names_in,
    read_rule,
    written,
)
from tcrdata.rules.sql_files import SqlFile, read_sql_file, uses

if TYPE_CHECKING:
    import duckdb

FIELDS = ("rules", "required", "cues")
MAY_HAVE = ("ignore", LOOSENED, NEXT, FOLLOWS)

_AnyRule = TypeVar("_AnyRule", bound=RuleText)


def preset_names() -> list[str]:
    """Names of the presets that ship with tcrdata."""
    return [path.stem for path in resource_files("queries/presets/*.sql")]


def load_preset(name: str) -> Preset:
    """Read a preset, its rules and the presets that it names included.

    Args:
        name: of one that ships with tcrdata, or the path of a `.sql` file of one's own; rules of
            one's own stand in a folder `rules` beside it.

    Raises:
        SettingsError: there is no such preset.
        RuleError: with file and line.
    """
    path = _path_of(name)
    if path != _shipped(path.stem):
        return _loaded(path)
    return _shipped_preset(path, written("queries/presets/*.sql", "queries/rules/*.sql"))


@lru_cache(maxsize=64)
def _shipped_preset(path: Path, stamps: tuple[int, ...]) -> Preset:
    """A preset that ships, read anew only when one of the files beside it has changed."""
    del stamps
    return _loaded(path)


def _loaded(path: Path) -> Preset:
    """Read a preset, its rules and the presets that it names included."""
    known: dict[str, Rule] = {}
    with Binder() as binder:
        preset = _read(path, binder, known)
        others = [
            _read(_other_path(preset.file, other), binder, known)
            for other in names_in(preset.file.fields.get("ignore", ""))
        ]
    preset = replace(preset, loosened=_loosened(preset.file), others=tuple(others))
    try:
        preset.fill()
    except SettingsError as error:
        raise RuleError(f"{path}:1: `-- loosened:` {error}") from error
    return preset


def load_follower(name: str) -> Preset:
    """Read the preset that takes the tracked boxes of a preset's labels.

    Args:
        name: of the preset that it names in `-- follows:`, or its path; it stands beside that, or
            among those that ship.

    Raises:
        SettingsError: there is none.
        RuleError: with file and line.
    """
    path = _path_of(name)
    named = re.compile(rf"^-- {FOLLOWS}:\s*{re.escape(path.stem)}\s*$", re.MULTILINE)
    for place in (*sorted(path.parent.glob("*.sql")), *resource_files("queries/presets/*.sql")):
        if named.search(place.read_text(encoding="utf-8")):
            return load_preset(str(place))
    raise SettingsError(
        f"no preset takes the tracked boxes of {path.stem}'s labels: write one with a line "
        f"`-- {FOLLOWS}: {path.stem}` in its header, or leave tracking out"
    )


@dataclass(frozen=True)
class PresetText:
    """What the files of a preset and its rules say, which may not bind.

    Attributes:
        rules: in order.
        parameters: of its rules and its own, with the preset's values, sorted by name.
    """

    rules: tuple[RuleText, ...]
    parameters: dict[str, Parameter]


def read_preset(name: str, connection: duckdb.DuckDBPyConnection) -> PresetText:
    """Read a preset without a look at whether it binds, in a fraction of the time.

    Args:
        name: as for `load_preset`.
        connection: runs the `set variable` lines, on a cursor of its own.

    Raises:
        SettingsError: there is no such preset.
        RuleError: with file and line.
    """
    path = _path_of(name)
    with connection.cursor() as cursor:
        file = read_sql_file(path, FIELDS, cursor, MAY_HAVE)
        places = {p.stem: p for p in resource_files("queries/rules/*.sql")}
        places |= {p.stem: p for p in (path.parent / "rules").glob("*.sql")}
        named = [rule for rule in names_in(file.fields["rules"]) if rule in places]
        rules = {rule: read_rule(places[rule], cursor) for rule in named}
    chosen = _chosen(file, rules)
    return PresetText(chosen, _parameters(file, rules, chosen))


def _path_of(name: str) -> Path:
    """Where a preset's file lies."""
    path = Path(name) if name.endswith(".sql") else _shipped(name)
    if not path.is_file():
        raise SettingsError(
            f"no preset '{name}'; there are {', '.join(preset_names())}, "
            "or give the path of a .sql file"
        )
    return path


def _shipped(name: str) -> Path:
    return resource_folder("queries") / "presets" / f"{name}.sql"


def _read(path: Path, binder: Binder, known: dict[str, Rule]) -> Preset:
    """A preset by itself; `known` holds the rules that were read already."""
    file = read_sql_file(path, FIELDS, binder.connection, MAY_HAVE)
    if path == _shipped(path.stem):
        # What ships fits together (a test sees to it), so that the others need not be read.
        named = [name for name in names_in(file.fields["rules"]) if name not in known]
        known |= load_rules(None, binder, named)
    else:
        known |= load_rules(path.parent / "rules", binder)
    chosen = _chosen(file, known)
    parameters = _parameters(file, known, chosen)
    literals = {name: parameter.literal for name, parameter in parameters.items()}
    (reads,) = binder.bind([(file, literals)], PRESET_COLUMNS, alone=False)
    required = frozenset(names_in(file.fields["required"]))
    cues = names_in(file.fields["cues"])
    _check_header(path, chosen, required, cues)
    return Preset(file.name, file.decides, chosen, required, cues, parameters, file, reads)


def _other_path(file: SqlFile, name: str) -> Path:
    """Where a preset lies that `-- ignore:` names: beside the file, or among those that ship."""
    if name == file.name:
        raise RuleError(f"{file.path}:1: `-- ignore:` names the preset itself")
    for path in (file.path.parent / f"{name}.sql", _shipped(name)):
        if path.is_file():
            return path
    raise RuleError(f"{file.path}:1: `-- ignore:` names {name}, which is no preset")


def _loosened(file: SqlFile) -> dict[str, str]:
    """`-- loosened: name = value, ...` of a header."""
    found = {}
    for part in names_in(file.fields.get(LOOSENED, "")):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not (equals and name and value):
            raise RuleError(f"{file.path}:1: `-- loosened:` needs name = value, this is '{part}'")
        found[name] = value
    return found


def _check_header(
    path: Path, chosen: tuple[Rule, ...], required: frozenset[str], cues: tuple[str, ...]
) -> None:
    """What the header lists fits together."""
    strangers = sorted(required - {rule.name for rule in chosen})
    if strangers:
        raise RuleError(f"{path}:1: required names {strangers[0]}, which `-- rules:` does not list")
    for rule in chosen:
        if rule.cues and not set(rule.cues) & set(cues):
            raise RuleError(
                f"{path}:1: rule {rule.name} reads what {' or '.join(rule.cues)} measures; "
                "name one in `-- cues:`"
            )


def _chosen(file: SqlFile, rules: Mapping[str, _AnyRule]) -> tuple[_AnyRule, ...]:
    """The rules that a preset lists."""
    names = names_in(file.fields["rules"])
    for name in names:
        if name not in rules:
            raise SettingsError(f"{file.path}:1: no rule '{name}'; there are {', '.join(rules)}")
        if names.count(name) > 1:
            raise RuleError(f"{file.path}:1: rule {name} is listed twice")
    if not names:
        raise RuleError(f"{file.path}:1: lists no rule")
    return tuple(rules[name] for name in names)


def _parameters(
    file: SqlFile, rules: Mapping[str, RuleText], chosen: Sequence[RuleText]
) -> dict[str, Parameter]:
    """Parameters of the chosen rules, with the preset's values, and the preset's own."""
    of_rules = {p.name: p for rule in rules.values() for p in rule.parameters}
    settled = {p.name: p for rule in chosen for p in rule.parameters}
    used = {name for name, _ in uses(file.select)}
    for parameter in file.parameters:
        where = f"{file.path}:{parameter.line}: {parameter.name}"
        original = of_rules.get(parameter.name)
        if original is None and parameter.name not in used:
            raise RuleError(f"{where} is set but neither its select nor a rule uses it")
        if original is not None and parameter.name not in settled:
            raise RuleError(f"{where} belongs to a rule that this preset does not list")
        if original is not None and original.kind != parameter.kind:
            raise RuleError(f"{where} must be a {original.kind}, as in {original.path.name}")
        if original is None:
            check_described(parameter)
        settled[parameter.name] = parameter
    return dict(sorted(settled.items()))


def check_presets(names: list[str]) -> list[Preset]:
    """Load presets together: no two may set a parameter of their own by the same name.

    Raises:
        RuleError: two do.
    """
    presets = [load_preset(name) for name in names]
    of_rules = {p.name for preset in presets for rule in preset.rules for p in rule.parameters}
    check_unique(p for preset in presets for p in preset.file.parameters if p.name not in of_rules)
    return presets
