"""What each rule of a selection decides, the SQL that decided, and every parameter it ran with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tcrdata.rules import Parameter, Preset, Rule, load_preset, load_rules, preset_names
from tcrdata.views.report.cards import RuleWords
from tcrdata.views.report.html import details, table, tag, text
from tcrdata.views.report.sql_text import sql_block

Row = Mapping[str, Any]


@dataclass(frozen=True)
class RuleBook:
    """Rules and preset of a selection, as far as their files still ship.

    Attributes:
        rules: name to rule.
        preset: None when it is a file of the user's own.
    """

    rules: Mapping[str, Rule]
    preset: Preset | None

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Name to parameter: the rules' and the preset's own."""
        own = {p.name: p for p in self.preset.file.parameters} if self.preset else {}
        return own | {p.name: p for rule in self.rules.values() for p in rule.parameters}

    def words(self) -> dict[str, RuleWords]:
        """Rule to its unit, that of the first number its condition names, and the condition."""
        units = {
            rule.name: parameter.unit.partition(" * ")[0]
            for rule in self.rules.values()
            for parameter in reversed(rule.parameters)
            if parameter.kind == "number" and parameter.name in rule.needs
        }
        return {
            name: RuleWords(units.get(name, ""), rule.needs) for name, rule in self.rules.items()
        }


def rule_book(selection: Row) -> RuleBook:
    """Read the shipped files of a selection's rules and preset."""
    shipped = load_rules()
    rules = {name: shipped[name] for name in selection["rules"] if name in shipped}
    preset = load_preset(selection["preset"]) if selection["preset"] in preset_names() else None
    return RuleBook(rules, preset)


def rule_sheets(selection: Row, book: RuleBook) -> str:
    """Return a fold a rule in the preset's order, then the preset's own select."""
    values = dict(selection["parameters"])
    sheets = [
        _sheet(name, sql, required, book.rules.get(name), values)
        for name, sql, required in zip(
            selection["rules"], selection["rule_texts"], selection["required"], strict=True
        )
    ]
    decides = book.preset.decides if book.preset else "A preset of the user's own."
    summary = f"{tag('b', text(selection['preset']))} {tag('span', 'the preset: ' + text(decides))}"
    words = tag(
        "p", "It sees what every rule let pass, gives it a state and a score.", class_="how"
    )
    return "".join(sheets) + details(summary, words + sql_block(selection["preset_text"]))


def _sheet(
    name: str, sql: str, required: bool, rule: Rule | None, values: Mapping[str, str]
) -> str:
    decides = (
        rule.decides if rule else "A rule of the user's own; its file is not among those shipped."
    )
    summary = f"{tag('b', text(name))} {tag('span', text(decides))}"
    facts = []
    if rule:
        facts += [("needs", rule.needs), ("source", rule.source)]
    facts.append(
        (
            "abstaining",
            "fails the candidate" if required else "does no harm: no evidence, no verdict",
        )
    )
    pairs = "".join(tag("dt", text(key)) + tag("dd", text(value)) for key, value in facts)
    content = [tag("dl", pairs, class_="facts")]
    if rule and rule.parameters:
        rows = [
            [
                tag("code", text(p.name)),
                text(values.get(p.name, p.literal)),
                text(p.unit),
                text(p.meaning),
            ]
            for p in rule.parameters
        ]
        content.append(table(["parameter", "value", "unit", "meaning"], rows, numeric_from=9))
    if rule and rule.select(dict(values)) != sql:
        content.append(
            tag(
                "p",
                "The rule's file has changed since; below is what this selection ran.",
                class_="note",
            )
        )
    content.append(sql_block(sql))
    return details(summary, "".join(content))


def first_sentence(words: str) -> str:
    """The first sentence of a text."""
    return words.partition(". ")[0].rstrip(".") + "."


def parameter_table(selection: Row, book: RuleBook) -> str:
    """Return every parameter the selection ran with; those the user changed stand out."""
    known = book.parameters
    preset = {n: p.literal for n, p in book.preset.parameters.items()} if book.preset else {}
    users = {p.name: rule.name for rule in book.rules.values() for p in rule.parameters}
    rows = []
    for name, literal in dict(selection["parameters"]).items():
        parameter = known.get(name)
        changed = name in preset and preset[name] != literal
        value = tag("span", text(literal), class_="changed") if changed else text(literal)
        if changed:
            value += tag("span", f"preset: {text(preset[name])}", class_="sub")
        rows.append(
            [
                tag("code", text(name)),
                value,
                text(parameter.unit if parameter else ""),
                text(users.get(name, "the preset")),
                text(parameter.meaning if parameter else ""),
            ]
        )
    return table(["parameter", "value", "unit", "rule", "meaning"], rows, numeric_from=9)


def changed_parameters(selection: Row, book: RuleBook) -> list[tuple[str, str, str]]:
    """Return name, value and the preset's value of what differs from the preset as it ships."""
    if book.preset is None:
        return []
    return [
        (name, literal, book.preset.parameters[name].literal)
        for name, literal in dict(selection["parameters"]).items()
        if name in book.preset.parameters and book.preset.parameters[name].literal != literal
    ]
