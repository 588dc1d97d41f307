"""The command line: a skin over the library. Data goes to stdout, messages to stderr."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

from cyclopts import CycloptsError

from tcrdata.cli import (
    build,
    check,
    compact,
    diff,
    draw,
    evaluate,
    evaluate_flow,
    evaluate_tracking,
    export,
    funnel,
    models,
    report,
    rules,
    snapshot,
    sql,
    status,
    test_rules,
    track,
    train,
    train_flow,
    view,
    views,
    warm,
    why,
)
from tcrdata.cli.app import app, group
from tcrdata.errors import TcrdataError

for _command in (
    build.build,
    check.check,
    compact.compact,
    diff.diff,
    draw.draw,
    export.export,
    funnel.funnel,
    models.models,
    report.report,
    rules.rules,
    snapshot.snapshot,
    sql.sql,
    status.status,
    test_rules.test_rules,
    track.track,
    view.view,
    views.views,
    warm.warm,
    why.why,
):
    app.command(_command)

group(
    evaluate.evaluate,
    flow=evaluate_flow.evaluate_flow,
    tracking=evaluate_tracking.evaluate_tracking,
)
group(train.train, flow=train_flow.train_flow)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command; an error becomes one line on stderr and a non-zero exit."""
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in tokens
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
