"""Presets: which rules, with which parameters, make a label."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from tcrdata.errors import SettingsError
from tcrdata.rules.binding import Reads
from tcrdata.rules.parameters import Parameter, to_literal
from tcrdata.rules.rule_files import Rule
from tcrdata.rules.sql_files import SqlFile, fill_in

LOOSENED = "loosened"
"""Name of the alternative that is the preset itself with looser bounds."""

NEXT = "next"
"""Field of a preset's header: the preset that selects in later rounds."""

FOLLOWS = "follows"
"""Field of a preset's header: the preset whose labels' tracked boxes this one takes, too."""


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
        alternatives: what only these accept is left undecided.
        follows: name of the preset whose labels' tracked boxes it takes; empty for none.
    """

    name: str
    rules: tuple[FilledRule, ...]
    select: str
    parameters: dict[str, str]
    cues: tuple[str, ...]
    reads: Reads
    alternatives: tuple[FilledPreset, ...] = ()
    follows: str = ""


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
        loosened: values of parameters with which a proposal that fails is left undecided.
        others: presets whose labels are left undecided where this one has none.
    """

    name: str
    decides: str
    rules: tuple[Rule, ...]
    required: frozenset[str]
    cues: tuple[str, ...]
    parameters: dict[str, Parameter]
    file: SqlFile
    reads: Reads
    loosened: Mapping[str, str] = field(default_factory=dict)
    others: tuple[Preset, ...] = ()

    @property
    def successor(self) -> str:
        """Name of the preset that selects in the next round: itself where it names none."""
        return self.file.fields.get(NEXT, "").strip() or self.name

    @property
    def follows(self) -> str:
        """Name of the preset whose labels' tracked boxes it takes; empty for none."""
        return self.file.fields.get(FOLLOWS, "").strip()

    def fill(self, overrides: Mapping[str, object] | None = None) -> FilledPreset:
        """Settle every parameter and fill it in.

        Args:
            overrides: parameter name to a value or its text, as `--set name=value` gives it.

        Raises:
            SettingsError: an unknown name, or a value of the wrong type.
        """
        alternatives = [replace(other.fill(), alternatives=()) for other in self.others]
        if self.loosened:
            loosened = self._filled({**(overrides or {}), **self.loosened})
            alternatives.insert(0, replace(loosened, name=LOOSENED))
        own = self._filled(overrides)
        return replace(own, alternatives=tuple(alternatives), follows=self.follows)

    def _filled(self, overrides: Mapping[str, object] | None) -> FilledPreset:
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
