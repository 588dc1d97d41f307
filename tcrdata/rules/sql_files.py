"""Reads a file of SQL that decides: header, parameters, one select.

Such a file runs as it is in any DuckDB shell. Here DuckDB's own tokenizer finds the statements and
the places where a parameter is used, so that strings and comments can never be mistaken for either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import duckdb

from tcrdata.errors import RuleError
from tcrdata.rules.parameters import Parameter, read_parameters
from tcrdata.rules.scopes import located
from tcrdata.rules.tokens import Token, line_of, tokens


@dataclass(frozen=True)
class SqlFile:
    """A parsed file.

    Attributes:
        path: file.
        decides: first paragraph of the header.
        fields: `-- name: value` lines of the header.
        parameters: in the order of the file.
        select: the one select, without comments around it and without its semicolon.
        select_line: 1-based line at which it starts.
    """

    path: Path
    decides: str
    fields: dict[str, str]
    parameters: tuple[Parameter, ...]
    select: str
    select_line: int

    @property
    def name(self) -> str:
        """Name of the file without its ending."""
        return self.path.stem


def read_sql_file(
    path: Path,
    field_names: tuple[str, ...],
    connection: duckdb.DuckDBPyConnection,
    may_have: tuple[str, ...] = (),
) -> SqlFile:
    """Read and split a file; nothing is bound yet.

    Args:
        path: file.
        field_names: fields that the header must have.
        connection: runs the `set variable` lines.
        may_have: fields that it may have besides.

    Raises:
        RuleError: with file and line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RuleError(f"{path}: cannot be read ({error}); give a readable UTF-8 file") from error
    decides, fields = _header(text, (*field_names, *may_have))
    missing = [name for name in field_names if name not in fields]
    if missing or not decides:
        wanted = f"a line '-- {missing[0]}: ...'" if missing else "a sentence on what it decides"
        raise RuleError(f"{path}:1: the header comment lacks {wanted}")
    *settings, (select_at, select) = _statements(path, text, connection)
    parameters = read_parameters(path, text, settings, connection)
    for index, parameter in enumerate(parameters):
        if parameter.name in (earlier.name for earlier in parameters[:index]):
            raise RuleError(f"{path}:{parameter.line}: parameter {parameter.name} is set twice")
    return SqlFile(path, decides, fields, parameters, select, line_of(text, select_at))


def uses(select: str) -> list[tuple[str, int]]:
    """Parameters that a select reads: name, and line within the select (0-based)."""
    return [(name, line_of(select, start) - 1) for start, _, name in _places(select)]


def fill_in(select: str, literals: Mapping[str, str]) -> str:
    """Put literals in the place of `getvariable('name')`, by position."""
    data = select.encode()
    for start, end, name in reversed(_places(select)):
        data = data[:start] + f"({literals[name]})".encode() + data[end:]
    return data.decode()


def _header(text: str, field_names: tuple[str, ...]) -> tuple[str, dict[str, str]]:
    """First paragraph and fields of the comment lines at the top; indented lines go on."""
    paragraph: list[str] = []
    fields: dict[str, str] = {}
    current = None
    for line in text.splitlines():
        if not line.startswith("--"):
            break
        body = line[2:]
        name, colon, value = body.partition(":")
        if colon and name.strip() in field_names:
            current = name.strip()
            fields[current] = value.strip()
        elif current and body.startswith("  "):
            fields[current] += " " + body.strip()
        elif not fields and current is None and body.strip():
            paragraph.append(body.strip())
        else:
            current = ""
    return " ".join(paragraph), fields


def _statements(path: Path, text: str, connection: duckdb.DuckDBPyConnection) -> list[Token]:
    """Split at semicolons: `set` statements, then one select."""
    try:
        kinds = [statement.type for statement in connection.extract_statements(text)]
    except duckdb.Error as error:
        raise RuleError(located(path, 1, error)) from error
    spans: list[list[Token]] = [[]]
    for start, token in tokens(text):
        if token.startswith(";"):
            spans.append([])
        else:
            spans[-1].append((start, token))
    pieces = [_span(text, span) for span in spans if span]
    if not pieces or len(pieces) != len(kinds):
        raise RuleError(f"{path}:1: holds no statement; it needs one select")
    for kind, (start, _) in zip(kinds[:-1], pieces[:-1], strict=True):
        if kind != duckdb.StatementType.SET:
            raise RuleError(
                f"{path}:{line_of(text, start)}: only `set variable` lines may stand before "
                f"the one select, this is {kind.name}"
            )
    if kinds[-1] != duckdb.StatementType.SELECT:
        raise RuleError(
            f"{path}:{line_of(text, pieces[-1][0])}: must end with one select, "
            f"this is {kinds[-1].name}; a rule or preset only reads"
        )
    return pieces


def _span(text: str, span: list[Token]) -> Token:
    """Text from the first token of a statement to the end of its last."""
    start, (last, token) = span[0][0], span[-1]
    return start, text.encode()[start : last + len(token.encode())].decode().strip()


@lru_cache(maxsize=256)
def _places(select: str) -> tuple[tuple[int, int, str], ...]:
    """Byte spans of `getvariable('name')` and the names; a text is filled in again and again."""
    words = tokens(select)
    places = []
    for (start, word), opened, (_, text), (last, closed) in zip(
        words, words[1:], words[2:], words[3:], strict=False
    ):
        call = (word.strip().lower(), opened[1].strip(), closed.strip()[:1])
        if call == ("getvariable", "(", ")") and text.startswith("'"):
            places.append((start, last + 1, text.strip()[1:-1]))
    return tuple(places)
