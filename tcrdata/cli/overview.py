"""What `tcrdata --help` says, without the parser of arguments: loading that takes far longer."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.machinery import PathFinder
from types import CodeType

COMMANDS = (
    "build", "check", "compact", "diff", "draw", "export", "funnel", "models", "report", "rules",
    "snapshot", "sql", "status", "test_rules", "track", "view", "views", "warm", "why",
)  # fmt: skip
"""Each is a function in the module of its name."""

GROUPS = ("evaluate", "train")
"""The same, and they have others below them."""

ABOUT = "Trusted 3D labels from unlabelled video: every candidate is a row, every check is SQL."
EPILOGUE = "Every command takes --debug, which shows the traceback of an error."

_OPTIONS = (
    ("--help (-h)", "Display this message and exit."),
    ("--version", "Display application version."),
)
_LEAST_WIDTH = 40
_CYAN, _BOLD, _PLAIN = "\33[36m", "\33[1m", "\33[0m"


def is_asked_for(tokens: Sequence[str]) -> bool:
    """Whether arguments ask for the program's own help, and stdout takes its frames."""
    utf8 = (sys.stdout.encoding or "").lower().startswith("utf")
    return utf8 and list(tokens) in ([], ["--help"], ["-h"])


def overview() -> str:
    """Return the help of the program, as the parser would draw it."""
    listed = [(name.replace("_", "-"), _does(name)) for name in sorted((*COMMANDS, *GROUPS))]
    listed += _OPTIONS
    width = _width()
    names = max(len(name) for name, _ in listed) + 2
    rows = []
    for name, does in listed:
        for line in _wrapped(does, width - names - 4):
            rows.append(f"│ {_shown(_CYAN, name.ljust(names))}{line:{width - names - 4}} │")
            name = ""
    paragraphs = (
        [_shown(_BOLD, "Usage: tcrdata COMMAND")],
        _wrapped(ABOUT, width),
        [f"╭─ Commands {'─' * (width - 13)}╮", *rows, f"╰{'─' * (width - 2)}╯"],
        _wrapped(EPILOGUE, width),
    )
    return "\n\n".join("\n".join(lines) for lines in paragraphs) + "\n"


def _does(name: str) -> str:
    """The first paragraph of a command's docstring, from its compiled module: none of it is run."""
    module = f"{__package__}.{name}"
    spec = PathFinder.find_spec(module, sys.modules[str(__package__)].__path__)
    code = spec.loader.get_code(module)  # type: ignore[union-attr]
    for function in code.co_consts:
        if isinstance(function, CodeType) and function.co_name == name:
            return str(function.co_consts[0]).partition("\n\n")[0]
    raise AttributeError(f"{module} has no function {name}")


def _width() -> int:
    """Columns of the terminal; 80 where there is none."""
    asked = os.environ.get("COLUMNS", "")
    try:
        columns = int(asked) if asked.isdigit() else os.get_terminal_size(1).columns
    except OSError:
        columns = 0
    return max(columns or 80, _LEAST_WIDTH)


def _wrapped(text: str, width: int) -> list[str]:
    """The words of a text in lines."""
    lines = [""]
    for word in text.split():
        fits = len(lines[-1]) + 1 + len(word) <= width
        lines[-1:] = [f"{lines[-1]} {word}".lstrip()] if fits else [lines[-1], word]
    return lines


def _shown(style: str, text: str) -> str:
    """A text in a style where a terminal shows it."""
    styled = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    return f"{style}{text}{_PLAIN}" if styled else text
