"""Presets: which rules, with which parameters, make a label."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tcrdata.errors import RuleError, SettingsError
from tcrdata.resources import resource_files, resource_folder
from tcrdata.rules.binding import PRESET_COLUMNS, Binder, Reads
from tcrdata.rules.rule_files import (
    Rule,
    check_described,
    check_unique,
    load_rules,
    names_in,
)
from tcrdata.rules.sql_files import Parameter, SqlFile, fill_in, read_sql_file, to_literal, uses

FIELDS = ("rules", "required", "cues")


@dataclass(frozen=True)
class FilledRule:
    """A rule with its parameters filled in.

    Attributes:
        name: the rule's.
        select: plain SQL.
        required: abstaining fails the proposal.
        reads: tables and columns.
    """

    name: str
    select: str
    required: bool
    reads: Reads


@dataclass(frozen=True)
class FilledPreset:
    """A preset ready to judge with.

    Attributes:
        name: the preset's.
        rules: in order.
        select: plain SQL over the proposals that passed.
        parameters: every parameter used, to its literal, sorted by name.
        cues: stages whose rows it reads.
        reads: tables and columns of the select.
    """

    name: str
    rules: tuple[FilledRule, ...]
    select: str
    parameters: dict[str, str]
    cues: tuple[str, ...]
    reads: Reads


@dataclass(frozen=True)
class Preset:
    """A preset as its file has it.

    Attributes:
        name: the file's name.
        decides: what it is, in a sentence or two.
        rules: in order.
        required: names of the rules of which abstaining fails a proposal.
        cues: stages whose rows it reads, as their own needs aside.
        parameters: of its rules and its own, with the preset's values, sorted by name.
        file: the parsed file.
        reads: tables and columns of its select.
    """

    name: str
    decides: str
    rules: tuple[Rule, ...]
    required: frozenset[str]
    cues: tuple[str, ...]
    parameters: dict[str, Parameter]
    file: SqlFile
    reads: Reads

    def fill(self, overrides: Mapping[str, object] | None = None) -> FilledPreset:
        """Settle every parameter and fill it in.

        Args:
            overrides: parameter name to a value or its text, as `--set name=value` gives it.

        Raises:
            SettingsError: an unknown name, or a value of the wrong type.
        """
        literals = {name: p.literal for name, p in self.parameters.items()}
        literals |= {k: self._override(k, v) for k, v in (overrides or {}).items()}
        rules = tuple(
            FilledRule(r.name, r.select(literals), r.name in self.required, r.reads)
            for r in self.rules
        )
        select = fill_in(self.file.select, literals)
        return FilledPreset(self.name, rules, select, literals, self.cues, self.reads)

    def _override(self, name: str, value: object) -> str:
        """The literal of an override."""
        parameter = self.parameters.get(name)
        if parameter is None:
            near = difflib.get_close_matches(name, self.parameters, n=3, cutoff=0.4)
            names = ", ".join(near or self.parameters) or "none"
            raise SettingsError(
                f"preset {self.name} has no parameter '{name}'; "
                f"{'near' if near else 'it has'}: {names}"
            )
        try:
            return to_literal(value, parameter.kind)
        except ValueError as error:
            raise SettingsError(f"parameter {name} {error}, not {value!r}") from error


def preset_names() -> list[str]:
    """Names of the presets that ship with tcrdata."""
    return [path.stem for path in resource_files("queries/presets/*.sql")]


def load_preset(name: str) -> Preset:
    """Read a preset, its rules included.

    Args:
        name: of one that ships with tcrdata, or the path of a `.sql` file of one's own; rules of
            one's own stand in a folder `rules` beside it.

    Raises:
        SettingsError: there is no such preset.
        RuleError: with file and line.
    """
    own = name.endswith(".sql")
    path = Path(name) if own else resource_folder("queries") / "presets" / f"{name}.sql"
    if not path.is_file():
        raise SettingsError(
            f"no preset '{name}'; there are {', '.join(preset_names())}, "
            "or give the path of a .sql file"
        )
    with Binder() as binder:
        file = read_sql_file(path, FIELDS, binder.connection)
        if own:
            rules = load_rules(path.parent / "rules", binder)
        else:
            # What ships fits together (a test sees to it), so that the others need not be read.
            rules = load_rules(None, binder, names_in(file.fields["rules"]))
        chosen = _chosen(file, rules)
        parameters = _parameters(file, rules, chosen)
        literals = {name: parameter.literal for name, parameter in parameters.items()}
        reads = binder.bind(file, literals, PRESET_COLUMNS, alone=False)
    required = frozenset(names_in(file.fields["required"]))
    cues = names_in(file.fields["cues"])
    _check_header(path, chosen, required, cues)
    return Preset(file.name, file.decides, chosen, required, cues, parameters, file, reads)


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


def _chosen(file: SqlFile, rules: Mapping[str, Rule]) -> tuple[Rule, ...]:
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
    file: SqlFile, rules: Mapping[str, Rule], chosen: tuple[Rule, ...]
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
