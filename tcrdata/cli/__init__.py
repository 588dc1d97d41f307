"""The command line: a skin over the library. Data goes to stdout, messages to stderr."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

from cyclopts import CycloptsError

from tcrdata.cli.app import app
from tcrdata.errors import TcrdataError

# Named, not imported: a command waits for no module but its own, and the list of all for each.
for _command in (
    "build", "check", "compact", "diff", "draw", "export", "funnel", "models", "report", "rules",
    "snapshot", "sql", "status", "test_rules", "track", "view", "views", "warm", "why",
):  # fmt: skip
    app.command(f"tcrdata.cli.{_command}:{_command}")
for _command in ("evaluate", "train"):
    app.command(f"tcrdata.cli.groups:{_command}_commands", name=_command)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command; an error becomes one line on stderr and a non-zero exit."""
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in tokens
    if not tokens or tokens[0] in app.help_flags:
        for name in app:
            app[name]  # what it does stands in its module
    try:
        code = app([token for token in tokens if token != "--debug"])
        sys.stdout.flush()
        sys.exit(code if isinstance(code, int) else 0)
    except CycloptsError as error:
        sys.stderr.write(f"tcrdata: {' '.join(str(error).split())} See tcrdata --help.\n")
        sys.exit(2)
    except TcrdataError as error:
        if debug:
            raise
        sys.stderr.write(f"tcrdata: {' '.join(str(error).split())}\n")
        sys.exit(1)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)
    except KeyboardInterrupt:
        sys.stderr.write("tcrdata: stopped; what is done is kept\n")
        sys.exit(130)
    except Exception as error:
        if debug:
            raise
        kind = type(error).__name__
        sys.stderr.write(
            f"tcrdata: unexpected {kind}: {' '.join(str(error).split())}; run with --debug\n"
        )
        sys.exit(70)
