"""`python -m tcrdata`, and the command `tcrdata`.

Worker processes import this module as their own main module: it loads nothing until it is run.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence
from typing import NoReturn


def main() -> NoReturn:
    """Run the command that the arguments of this process name."""
    # What is imported stays: looking through it for garbage at every turn takes a command's time.
    gc.set_threshold(50_000, 20, 50)
    if _builds(sys.argv[1:]):
        from tcrdata import executors

        # Workers get ready while this process reads what there is to do.
        executors.start_server()
    from tcrdata import cli

    cli.main()


def _builds(arguments: Sequence[str]) -> bool:
    """Whether the arguments surely ask for a build with workers; the command itself knows."""
    others = ("--help", "-h", "--dry-run", "--workers")
    plain = arguments[:1] == ["build"] and not any(a.startswith(others) for a in arguments)
    return plain and len(os.sched_getaffinity(0)) > 1


if __name__ == "__main__":
    main()
