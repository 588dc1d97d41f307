"""Reads cases of rules: given rows, expected verdicts.

A folder of rules has `rules/<rule>.sql` and `cases/<rule>.toml`, as `queries/` has; where it has no
folder `rules`, both lie in the folder itself. A case file is a list of cases:

    [[case]]
    name = "at the bound, beyond"
    set = { max_range_m = 30 }                                  # may be left out
    tolerance = 0.01                                            # may be left out
    given.proposals = [{ range_m = 30.0 }, { range_m = 31.0 }]  # the columns that matter
    given.egomotions = [{ frame = 0, method = "odometry" }]     # any other table of evidence
    expected = [                                                # a verdict a proposal, in order
      { value = 30.0, bound = 30.0, passed = true },
      { value = 31.0, bound = 30.0, passed = false },
    ]

What is left out of a verdict is expected to be NULL: without `passed` the rule must abstain.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tcrdata.errors import RuleError

VERDICT = ("value", "bound", "passed")


@dataclass(frozen=True)
class Case:
    """One case of a rule.

    Attributes:
        path: its file.
        name: what it shows.
        given: table to rows.
        expected: a verdict for each given proposal, in their order.
        overrides: values of parameters other than the rule's own.
        tolerance: largest difference of numbers, in their own unit; 0 allows rounding alone.
    """

    path: Path
    name: str
    given: Mapping[str, list[dict[str, Any]]]
    expected: list[dict[str, Any]]
    overrides: Mapping[str, Any]
    tolerance: float


def read_cases(path: Path) -> list[Case]:
    """Read a case file.

    Raises:
        RuleError: it cannot be read, is no TOML, or a case lacks something; names both.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RuleError(f"{path}: cannot be read as TOML ({error}): correct it") from error
    cases = content.get("case")
    if not isinstance(cases, list) or not cases or set(content) != {"case"}:
        raise RuleError(f"{path}: holds no list of cases: start each with a line [[case]]")
    return [_case(path, number, case) for number, case in enumerate(cases, start=1)]


def _case(path: Path, number: int, content: Any) -> Case:
    """One case of a file, checked."""
    content = content if isinstance(content, dict) else {}
    name = str(content.get("name", f"number {number}"))
    given, expected = content.get("given"), content.get("expected")
    case = Case(
        path, name, given if isinstance(given, dict) else {},
        expected if isinstance(expected, list) else [],
        content.get("set", {}), content.get("tolerance", 0.0),
    )  # fmt: skip
    if strangers := set(content) - {"name", "set", "tolerance", "given", "expected"}:
        raise wrong(case, f"'{min(strangers)}' is none of name, set, tolerance, given, expected")
    for rows in case.given.values():
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise wrong(case, "given.<table> is a list of rows: [{ column = value }, ...]")
    if not isinstance(case.overrides, dict):
        raise wrong(case, "set is a table of parameters: { parameter = value }")
    proposals = case.given.get("proposals", [])
    if not proposals or len(case.expected) != len(proposals):
        raise wrong(
            case,
            f"has {len(proposals)} given.proposals and {len(case.expected)} expected: "
            "give at least one, and a verdict for each",
        )
    for verdict in case.expected:
        if not isinstance(verdict, dict) or set(verdict) - set(VERDICT):
            raise wrong(case, f"expected {verdict}: a verdict has value, bound and passed")
    if not isinstance(case.tolerance, int | float) or not case.tolerance >= 0:
        raise wrong(case, f"tolerance {case.tolerance}: give a number, 0 or more")
    return case


def wrong(case: Case, message: str) -> RuleError:
    """Return an error that names file and case, in one line."""
    return RuleError(f"{case.path}: case '{case.name}': {' '.join(message.split())}")
