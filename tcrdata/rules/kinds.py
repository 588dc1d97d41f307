"""Proposals that are alike to the rules that open presets: judged once a kind, not once each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import duckdb

from tcrdata.rules.scopes import quoted

OF_KINDS = {"source", "fit", "found"}
"""Columns of `proposals` that make the kinds: each has a few values."""

Kinds = Sequence[Mapping[str, Any]]
"""Rows of such columns with what rules made of them, `carried` and `alive`."""


def kinds_of(connection: duckdb.DuckDBPyConnection) -> Kinds:
    """The rows of the table `kinds`, in order."""
    connection.execute("from kinds order by all")
    names = [column[0] for column in connection.description or ()]
    return [dict(zip(names, row, strict=True)) for row in connection.fetchall()]


def of_kinds(kinds: Kinds) -> tuple[str, str]:
    """SQL of `carried` and of `alive` of a proposal; both are 0 where it is of no such kind."""
    return _chosen(kinds, "carried"), _chosen(kinds, "alive")


def _chosen(kinds: Kinds, what: str) -> str:
    cases = "".join(f" when {_alike(kind)} then {kind[what]}" for kind in kinds)
    return f"case{cases} else 0 end"


def _alike(kind: Mapping[str, Any]) -> str:
    """SQL of whether a proposal has the texts of a kind."""
    texts = {name: text for name, text in kind.items() if name not in ("carried", "alive")}
    return " and ".join(
        f"{name} is null" if text is None else f"{name} = {quoted(text)}"
        for name, text in texts.items()
    )
