"""Rules: one file a rule, what must hold for one proposal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from tcrdata.errors import RuleError
from tcrdata.resources import resource_files, resource_folder
from tcrdata.rules.binding import RULE_COLUMNS, Binder, Reads
from tcrdata.rules.parameters import Parameter
from tcrdata.rules.sql_files import SqlFile, fill_in, read_sql_file, uses

if TYPE_CHECKING:
    import duckdb


@dataclass(frozen=True)
class RuleText:
    """A rule as its file has it, which may not bind.

    Attributes:
        name: the file's name.
        decides: what it decides, in a sentence or two.
        source: where in the literature it comes from.
        needs: the condition, as people read it.
        cues: stages that can measure what it reads; empty when any proposal has it.
        parameters: in the order of the file.
        file: the parsed file.
    """

    name: str
    decides: str
    source: str
    needs: str
    cues: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    file: SqlFile

    def select(self, literals: dict[str, str]) -> str:
        """The rule's select with its parameters filled in.

        Args:
            literals: parameter name to SQL literal; the rule's own where it is absent.
        """
        own = {p.name: p.literal for p in self.parameters}
        return fill_in(self.file.select, own | literals)


@dataclass(frozen=True)
class Rule(RuleText):
    """A rule that binds.

    Attributes:
        reads: tables and columns.
    """

    reads: Reads


def read_rule(path: Path, connection: duckdb.DuckDBPyConnection) -> RuleText:
    """Read one rule; whether it binds is not looked at.

    Args:
        path: its file.
        connection: runs the `set variable` lines.

    Raises:
        RuleError: with file and line.
    """
    file = read_sql_file(path, ("source", "needs", "cues"), connection)
    cues = names_in(file.fields["cues"])
    source, needs = file.fields["source"], file.fields["needs"]
    return RuleText(file.name, file.decides, source, needs, cues, file.parameters, file)


def load_rules(
    folder: Path | None = None,
    binder: Binder | None = None,
    named: Iterable[str] | None = None,
) -> dict[str, Rule]:
    """Read the rules that ship with tcrdata, and those of a folder of one's own.

    Args:
        folder: holds `<rule>.sql` files; its names and parameters must not be taken already.
        binder: binds them; one of its own without.
        named: read no others; None for all.

    Returns:
        name to rule, sorted by name.

    Raises:
        RuleError: with file and line.
    """
    if folder is None and binder is None and named is None:
        return dict(_shipped_rules(written("queries/rules/*.sql")))
    if binder is None:
        with Binder() as own:
            return load_rules(folder, own, named)
    shipped = resource_folder("queries") / "rules"
    paths = sorted(shipped.glob("*.sql"))
    if folder is not None and folder.resolve() != shipped.resolve():
        paths += sorted(folder.glob("*.sql"))
    wanted = {path.stem for path in paths} if named is None else set(named)
    rules = _bound([path for path in paths if path.stem in wanted], binder)
    check_unique([p for rule in rules for p in rule.parameters])
    for index, rule in enumerate(rules):
        earlier = next((r for r in rules[:index] if r.name == rule.name), None)
        if earlier is not None:
            raise RuleError(f"{rule.file.path}:1: a rule {rule.name} is in {earlier.file.path} too")
    return {rule.name: rule for rule in sorted(rules, key=lambda rule: rule.name)}


def written(*patterns: str) -> tuple[int, ...]:
    """Return when each file of some patterns, as `resource_files` takes them, was written."""
    return tuple(p.stat().st_mtime_ns for pattern in patterns for p in resource_files(pattern))


@lru_cache(maxsize=2)
def _shipped_rules(stamps: tuple[int, ...]) -> dict[str, Rule]:
    """The rules that ship, read anew only when one of their files has changed."""
    del stamps
    with Binder() as binder:
        return load_rules(None, binder)


def _bound(paths: Sequence[Path], binder: Binder) -> list[Rule]:
    """The rules of some files, which bind on empty tables."""
    texts = [read_rule(path, binder.connection) for path in paths]
    literals = [{p.name: p.literal for p in text.parameters} for text in texts]
    files = [(text.file, own) for text, own in zip(texts, literals, strict=True)]
    reads = binder.bind(files, RULE_COLUMNS, alone=True)
    for text in texts:
        used = {name for name, _ in uses(text.file.select)}
        for parameter in text.parameters:
            if parameter.name not in used:
                where = f"{parameter.path}:{parameter.line}"
                raise RuleError(f"{where}: {parameter.name} is set but not used")
            check_described(parameter)
    return [Rule(**vars(text), reads=its) for text, its in zip(texts, reads, strict=True)]


def check_described(parameter: Parameter) -> None:
    """A parameter's line says what it means.

    Raises:
        RuleError: it does not.
    """
    if not parameter.meaning:
        raise RuleError(
            f"{parameter.path}:{parameter.line}: say what {parameter.name} means, on its line: "
            "`-- unit: meaning`"
        )


def check_unique(parameters: Iterable[Parameter]) -> None:
    """A parameter's name belongs to one file.

    Raises:
        RuleError: two files set it.
    """
    seen: dict[str, Parameter] = {}
    for parameter in parameters:
        other = seen.setdefault(parameter.name, parameter)
        if other is not parameter:
            raise RuleError(
                f"{parameter.path}:{parameter.line}: parameter {parameter.name} is set in "
                f"{other.path.name} too; name it otherwise"
            )


def names_in(field: str) -> tuple[str, ...]:
    """Names of a comma-separated header field."""
    return tuple(name.strip() for name in field.split(",") if name.strip())
