"""SQL with its keywords, strings, numbers and remarks told apart by colour."""

from __future__ import annotations

import re

from tcrdata.views.report.html import tag, text

_KEYWORDS = (
    "select|from|where|and|or|not|in|is|null|as|case|when|then|else|end|left|join|on|using|group|by"
    "|order|having|between|true|false|with|union|all|distinct|asof|anti|semi|over|partition|qualify"
    "|filter|exists|set|variable|limit|coalesce|cross|inner|desc|asc|interval|recursive|values"
)
_TOKEN = re.compile(
    rf"(?P<re>--[^\n]*)|(?P<st>'(?:[^']|'')*')|(?P<kw>\b(?:{_KEYWORDS})\b)"
    r"|(?P<nu>\b\d+(?:\.\d+)?(?:e-?\d+)?\b)",
    re.IGNORECASE,
)


def sql_block(sql: str) -> str:
    """Return a `pre` of SQL."""
    parts = []
    end = 0
    for found in _TOKEN.finditer(sql):
        parts.append(text(sql[end : found.start()]))
        parts.append(tag("span", text(found.group()), class_=found.lastgroup))
        end = found.end()
    parts.append(text(sql[end:]))
    return tag("pre", tag("code", *parts))
