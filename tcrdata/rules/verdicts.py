"""The select behind the view `verdicts`: all rules of a selection in one pass over the proposals.

A rule that only hands the id on is made to hand on the whole row, so rules stand inside one another
and nothing is joined but what a rule joins itself. Any other rule is joined by the id.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tcrdata.rules.binding import EVIDENCE_TABLES, RULE_COLUMNS, Binder, Reads
from tcrdata.rules.rounds import of_round
from tcrdata.rules.scopes import handing_on, judged_frames, quoted, scoped
from tcrdata.rules.sql_files import SqlFile

_KEYS = ("proposal_id", "dataset", "sequence", "frame", "source")
_VERDICT = ("value", "bound", "passed")
_MARGIN = (
    "case when isfinite({bound}) then if({passed}, 1, if({passed} is null, null, -1)) "
    "* abs({value} - {bound}) / if({bound} = 0, 1, abs({bound})) end"
)


def verdicts_selects(selections: Sequence[Mapping[str, Any]]) -> list[str]:
    """SQL of each selection's rows of `verdicts`; it names evidence tables without a schema.

    Args:
        selections: rows of `selections`.

    Raises:
        RuleError: a rule's text does not bind on this version's tables.
    """
    reads = _reads(selections)
    return [_select(selection, reads) for selection in selections]


def columns_read(selections: Sequence[Mapping[str, Any]]) -> list[str]:
    """Columns of `proposals` that the selections' rows of `verdicts` are made from, sorted."""
    return _wanted(_reads(selections).values())


def _reads(selections: Sequence[Mapping[str, Any]]) -> dict[str, Reads]:
    """Each different text of a rule with what it reads."""
    texts = {
        text: rule
        for selection in selections
        for rule, text in zip(selection["rules"], selection["rule_texts"], strict=True)
    }
    files: list[tuple[SqlFile, Mapping[str, str]]] = [
        (SqlFile(Path(rule), "", {}, (), text, 1), {}) for text, rule in texts.items()
    ]
    with Binder() as binder:
        return dict(zip(texts, binder.bind(files, RULE_COLUMNS, alone=True), strict=True))


def _wanted(reads: Iterable[Reads]) -> list[str]:
    return sorted({*_KEYS, *(column for read in reads for column in read.columns)})


def _select(selection: Mapping[str, Any], reads: Mapping[str, Reads]) -> str:
    """SQL of one selection's rows."""
    texts = selection["rule_texts"]
    number = int(selection["round"])
    relations = {table: of_round(table, number) for table in EVIDENCE_TABLES}
    wanted = _wanted(reads[text] for text in texts)
    rows = f"(select {', '.join(wanted)} from {of_round('proposals', number)})"
    for place, text in enumerate(texts):
        rows = _judged(rows, place, text, reads[text], relations)
    return f"select {_columns(selection)}\nfrom {rows}"


def _judged(rows: str, place: int, text: str, read: Reads, relations: Mapping[str, str]) -> str:
    """The rows with a rule's value, bound and verdict behind them."""
    renamed = ", ".join(f"{name} as {name}_{place}" for name in _VERDICT)
    of_frames = judged_frames(text, read, relations)
    if of_frames:
        verdicts, keys = of_frames
        return f"(select r.*, {renamed}\nfrom {rows} r join ({verdicts}) v using ({keys}))"
    whole = handing_on(text, "{p}.*") if read.passes_id or read.starts_with_id else None
    if whole:
        verdicts = scoped(whole, read.tables, {**relations, "proposals": rows})
        return f"(select * exclude ({', '.join(_VERDICT)}), {renamed}\nfrom ({verdicts}))"
    verdicts = scoped(text, read.tables, relations)
    return f"(select r.*, {renamed}\nfrom {rows} r join ({verdicts}) v using (proposal_id))"


def _columns(selection: Mapping[str, Any]) -> str:
    """The columns of `verdicts`, from the rows that went through all rules."""
    places = range(len(selection["rules"]))
    names = {n: [f"{n}_{place}" for place in places] for n in _VERDICT}
    margins = [_MARGIN.format(**{n: names[n][place] for n in _VERDICT}) for place in places]
    blocks = [
        f"passed_{place} is not true" if required else f"passed_{place} is false"
        for place, required in enumerate(selection["required"])
    ]
    columns = {
        "selection_id": quoted(selection["selection_id"]),
        "selection": quoted(selection["name"]),
        **{name: name for name in _KEYS},
        "rules": f"[{', '.join(quoted(rule) for rule in selection['rules'])}]",
        "value": f"[{', '.join(names['value'])}]",
        "bound": f"[{', '.join(names['bound'])}]",
        "margin": f"[{', '.join(margins)}]",
        "passed": f"[{', '.join(names['passed'])}]",
        "failed": _mask(f"passed_{place} is false" for place in places),
        "abstained": _mask(f"passed_{place} is null" for place in places),
        "blocked": _mask(blocks),
    }
    return ",\n".join(f"{value} as {name}" for name, value in columns.items())


def _mask(conditions: Iterable[str]) -> str:
    """A bit a condition, the first one lowest."""
    bits = [f"if({condition}, {1 << place}, 0)" for place, condition in enumerate(conditions)]
    return f"({' | '.join(bits)})::bigint"
