"""What the rules decide, with their parameters, as rows."""

from __future__ import annotations

from dataclasses import dataclass

from tcrdata.rules import Parameter, Preset, Rule, load_preset, load_rules


@dataclass(frozen=True)
class ParameterEntry:
    """A parameter of a rule.

    Attributes:
        name: as `--set name=value` takes it.
        default: the rule's own value, as an SQL literal.
        value: the preset's value; the default where it sets none.
        unit: of both.
        meaning: what it bounds.
    """

    name: str
    default: str
    value: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class RuleEntry:
    """A rule as people read it.

    Attributes:
        rule: its name.
        decides: what must hold for one proposal.
        source: where in the literature it comes from.
        needs: the condition.
        required: abstaining fails the proposal; None without a preset.
        cues: stages that can measure what it reads; empty when any proposal has it.
        parameters: in the order of the file.
    """

    rule: str
    decides: str
    source: str
    needs: str
    required: bool | None
    cues: tuple[str, ...]
    parameters: tuple[ParameterEntry, ...]


@dataclass(frozen=True)
class Catalogue:
    """Rules and, when asked for, the preset that lists them.

    Attributes:
        preset: name; None for all rules that ship.
        takes: what the preset takes, in a sentence or two; empty without one.
        rules: in the preset's order, else by name.
        own: parameters of the preset's own select.
    """

    preset: str | None
    takes: str
    rules: tuple[RuleEntry, ...]
    own: tuple[ParameterEntry, ...]


def catalogue(preset: str | None = None) -> Catalogue:
    """Describe a preset's rules, or all that ship with tcrdata.

    Args:
        preset: name, or path of one's own.

    Raises:
        SettingsError: there is no such preset.
        RuleError: a file is wrong; names file and line.
    """
    if preset is None:
        rules = tuple(_entry(rule, None) for rule in load_rules().values())
        return Catalogue(None, "", rules, ())
    loaded = load_preset(preset)
    of_rules = {parameter.name for rule in loaded.rules for parameter in rule.parameters}
    own = tuple(
        _parameter(parameter, parameter)
        for parameter in loaded.file.parameters
        if parameter.name not in of_rules
    )
    rules = tuple(_entry(rule, loaded) for rule in loaded.rules)
    return Catalogue(loaded.name, loaded.decides, rules, own)


def _entry(rule: Rule, preset: Preset | None) -> RuleEntry:
    """One rule, with a preset's values."""
    settled = preset.parameters if preset else {p.name: p for p in rule.parameters}
    return RuleEntry(
        rule.name, rule.decides, rule.source, rule.needs,
        rule.name in preset.required if preset else None, rule.cues,
        tuple(_parameter(parameter, settled[parameter.name]) for parameter in rule.parameters),
    )  # fmt: skip


def _parameter(own: Parameter, settled: Parameter) -> ParameterEntry:
    """One parameter; a preset's line gives the value, the rule's the meaning."""
    return ParameterEntry(own.name, own.literal, settled.literal, own.unit, own.meaning)
