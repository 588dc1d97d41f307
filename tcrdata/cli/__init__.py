"""The command line: a skin over the library. Data goes to stdout, messages to stderr."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

from tcrdata.cli import overview
from tcrdata.errors import TcrdataError, Terminated


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command; an error becomes one line on stderr and a non-zero exit."""
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in tokens
    tokens = [token for token in tokens if token != "--debug"]
    try:
        code = _run(tokens)
        sys.stdout.flush()
        sys.exit(code)
    except TcrdataError as error:
        if debug:
            raise
        sys.stderr.write(f"tcrdata: {' '.join(str(error).split())}\n")
        sys.exit(1)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)
    except KeyboardInterrupt as stopped:
        sys.stderr.write("tcrdata: stopped; what is done is kept\n")
        sys.exit(143 if isinstance(stopped, Terminated) else 130)
    except Exception as error:
        if debug:
            raise
        kind = type(error).__name__
        sys.stderr.write(
            f"tcrdata: unexpected {kind}: {' '.join(str(error).split())}; run with --debug\n"
        )
        sys.exit(70)


def _run(tokens: list[str]) -> int:
    """Run the command that arguments name; return its exit code."""
    if overview.is_asked_for(tokens):
        sys.stdout.write(overview.overview())
        return 0
    from cyclopts import CycloptsError

    from tcrdata.cli.app import app

    if not tokens or tokens[0] in app.help_flags:
        for name in app:
            app[name]  # what it does stands in its module
    try:
        code = app(tokens)
    except CycloptsError as error:
        sys.stderr.write(f"tcrdata: {' '.join(str(error).split())} See tcrdata --help.\n")
        return 2
    return code if isinstance(code, int) else 0
