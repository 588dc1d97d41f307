"""Words of SQL as DuckDB's own tokenizer finds them, and where they stand."""

from __future__ import annotations

import duckdb

Token = tuple[int, str]  # byte offset, text


def tokens(sql: str) -> list[Token]:
    """Tokens without comments (which only some DuckDB versions report)."""
    data = sql.encode()
    starts = [start for start, _ in duckdb.tokenize(sql)]
    ends = [*starts[1:], len(data)][: len(starts)]
    found = [(a, data[a:b].decode()) for a, b in zip(starts, ends, strict=True)]
    return [(a, text) for a, text in found if not text.startswith(("--", "/*"))]


def line_of(text: str, byte_offset: int) -> int:
    """1-based line of a byte offset."""
    return text.encode()[:byte_offset].count(b"\n") + 1
