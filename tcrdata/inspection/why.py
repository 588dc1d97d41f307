"""Why a proposal became what it is: each rule's verdict, which decides, what is behind it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tcrdata.errors import SettingsError
from tcrdata.inspection.finding import Found
from tcrdata.inspection.flips import hold_ready, passing_value
from tcrdata.inspection.sentences import need, sentence
from tcrdata.reports import report_rows
from tcrdata.rules import PresetText, RuleText, read_preset


@dataclass(frozen=True)
class RuleVerdict:
    """What one rule says of the proposal.

    Attributes:
        rule: its name.
        verdict: passed, failed or abstained.
        required: abstaining stops the proposal.
        value: what was measured; None without evidence.
        bound: what it was compared with; None where no numbers are.
        margin: distance of the two in bounds, positive where the rule passes; None without.
        stops: it keeps the proposal from being a label.
        alone: no other rule does.
        tightest: no rule stops the proposal, and this one passed with the smallest margin.
        needs: what it asks, such as `<= 0.25 m`.
        says: the verdict as a sentence.
        source: where in the literature the rule comes from; empty when its file is not known.
        change: `parameter=value` that would let it pass, tried on this proposal; None without.
    """

    rule: str
    verdict: str
    required: bool
    value: float | None
    bound: float | None
    margin: float | None
    stops: bool
    alone: bool
    tightest: bool
    needs: str
    says: str
    source: str
    change: str | None


@dataclass(frozen=True)
class Explanation:
    """All that is known of a proposal.

    Attributes:
        proposal: row of `why_proposal`: box, points and label.
        selection_id: of the selection that is explained.
        selection: its name.
        preset: the preset it ran.
        round: EM round that it judged.
        parameters: `name=value` of those in which the selection differs from its preset.
        outcome: positive, ignore, rejected or left out.
        ignored_because: loosened, or the preset that accepts it; None unless it is ignore.
        rules: in the selection's order.
        evidence: rows of `why_evidence`.
        relations: rows of `why_outcomes`: region, track and place, in this selection.
        others: rows of `why_outcomes`: this proposal in the other selections.
        nearest: rows of `why_nearest`, the one taken first; empty when the id was given.
        labels: rows of `why_labels`: the selection's other labels of the frame.
        points: indices of the proposal's points in the frame.
    """

    proposal: Mapping[str, Any]
    selection_id: str
    selection: str
    preset: str
    round: int
    parameters: tuple[str, ...]
    outcome: str
    ignored_because: str | None
    rules: tuple[RuleVerdict, ...]
    evidence: tuple[dict[str, Any], ...]
    relations: tuple[dict[str, Any], ...]
    others: tuple[dict[str, Any], ...]
    nearest: tuple[dict[str, Any], ...]
    labels: tuple[dict[str, Any], ...]
    points: tuple[int, ...]

    @property
    def changes(self) -> tuple[str, ...]:
        """`parameter=value` that together let every rule pass; empty when there are none."""
        stopping = [verdict.change for verdict in self.rules if verdict.stops]
        return tuple(c for c in stopping if c) if all(stopping) else ()

    def to_json(self) -> dict[str, Any]:
        """Return what people ask for as plain values: all but points and other labels."""
        values = dataclasses.asdict(self)
        left_out = ("labels", "points")
        return {
            **{name: value for name, value in values.items() if name not in left_out},
            "changes": self.changes,
        }


def explain(selection: Mapping[str, Any], found: Found, preset: str | None = None) -> Explanation:
    """Explain what a selection made of a proposal.

    Args:
        selection: row of `selections`.
        found: the proposal.
        preset: path of the preset that the selection ran, when it is none that ships; without it
            units and sources of such rules stay unknown.

    Raises:
        RuleError: the preset's file is wrong; names file and line.
    """
    place = (found.dataset, found.sequence)
    asked = {"selection_id": selection["selection_id"], "proposal_id": found.proposal_id}
    proposal = _rows(found, "why_proposal", asked)[0]
    points = proposal.pop("point_indices") or ()
    every = found.drives.selections(*place, selection["round"])
    found.drives.judge(found.connection, every, place, proposal["frame"], proposal["track_id"])
    outcomes = _rows(found, "why_outcomes", asked)
    itself = [row for row in outcomes if row["relation"] == "itself"]
    own = next(row for row in itself if row["selection_id"] == selection["selection_id"])
    loaded = _preset_of(found, selection, preset)
    return Explanation(
        proposal,
        selection["selection_id"],
        selection["name"],
        selection["preset"],
        selection["round"],
        _differing(selection, loaded),
        own["outcome"],
        own["ignored_because"],
        tuple(_verdicts(found, selection, loaded, _rows(found, "why_rules", asked))),
        tuple(_rows(found, "why_evidence", {"proposal_id": found.proposal_id})),
        tuple(row for row in outcomes if row["relation"] != "itself"),
        tuple(row for row in itself if row is not own),
        found.nearest,
        tuple(_rows(found, "why_labels", asked)),
        tuple(points),
    )


def _rows(found: Found, report: str, parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    return report_rows(found.connection, report, parameters)


def _preset_of(found: Found, selection: Mapping[str, Any], path: str | None) -> PresetText | None:
    """The preset that the selection ran; None when it does not ship and no path is given."""
    try:
        return read_preset(path or selection["preset"], found.connection)
    except SettingsError:
        if path is not None:
            raise
        return None


def _literals(selection: Mapping[str, Any]) -> dict[str, str]:
    """Parameter to its literal in the selection."""
    return dict(selection["parameters"])


def _differing(selection: Mapping[str, Any], preset: PresetText | None) -> tuple[str, ...]:
    """`name=value` where the selection has another value than its preset."""
    if preset is None:
        return ()
    return tuple(
        f"{name}={literal.strip(chr(39))}"
        for name, literal in sorted(_literals(selection).items())
        if name in preset.parameters and preset.parameters[name].literal != literal
    )


def _verdicts(
    found: Found,
    selection: Mapping[str, Any],
    preset: PresetText | None,
    rows: Sequence[Mapping[str, Any]],
) -> list[RuleVerdict]:
    """Rows of `why_rules` in words."""
    literals = _literals(selection)
    texts = dict(zip(selection["rules"], selection["rule_texts"], strict=True))
    # A rule whose file says something else by now explains nothing.
    known: dict[str, RuleText] = {
        rule.name: rule
        for rule in (preset.rules if preset else ())
        if rule.select(literals) == texts.get(rule.name)
    }
    stopping = [known[row["rule"]] for row in rows if row["stops"] and row["rule"] in known]
    hold_ready(found.connection, found.proposal_id, stopping)
    verdicts = []
    for row in rows:
        rule = known.get(row["rule"])
        change = None
        if rule is not None and row["stops"]:
            change = passing_value(found.connection, rule, literals, row["value"])
        told = (rule, row["value"], row["bound"], row["verdict"])
        verdicts.append(
            RuleVerdict(
                row["rule"], row["verdict"], row["required"], row["value"], row["bound"],
                row["margin"], row["stops"], row["alone"], row["tightest"],
                need(*told), sentence(row["rule"], *told), rule.source if rule else "",
                "=".join(change) if change else None,
            )
        )  # fmt: skip
    return verdicts
