"""`python -m tcrdata`, and the command `tcrdata`.

Worker processes import this module as their own main module: it loads nothing until it is run.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from types import FrameType
from typing import NoReturn


def main() -> NoReturn:
    """Run the command that the arguments of this process name, and end the process at once.

    Taking apart everything that was imported, object by object, takes longer than many a command.
    """
    try:
        command()
    except KeyboardInterrupt:
        # Before the command line itself is there to say so.
        sys.stderr.write("tcrdata: stopped\n")
        os._exit(130)
    except SystemExit as ended:
        atexit._run_exitfuncs()
        # A reader that has gone has closed them.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(ended.code if isinstance(ended.code, int) else bool(ended.code))


def _terminate(*_: int | FrameType | None) -> NoReturn:
    from tcrdata.errors import Terminated

    raise Terminated


def command() -> NoReturn:
    """Run the command that the arguments of this process name.

    Raises:
        SystemExit: it is over, with its code.
    """
    # What is imported stays: looking through it for garbage at every turn takes a command's time.
    gc.set_threshold(50_000, 20, 50)
    preload = _preload(sys.argv[1:])
    if preload:
        from tcrdata import executors

        # Workers get ready while this process reads what there is to do.
        executors.start_server(getattr(executors, preload))
    from tcrdata import cli

    # Until here there is nothing to keep or remove, nor anyone to say so.
    signal.signal(signal.SIGTERM, _terminate)
    cli.main()


def _preload(arguments: Sequence[str]) -> str:
    """Name what workers need, where arguments surely ask for some; the command itself knows."""
    others = ("--help", "-h", "--dry-run", "--workers")
    if len(os.sched_getaffinity(0)) < 2 or any(a.startswith(others) for a in arguments):
        return ""
    return {"build": "PRELOAD", "track": "TRACKING"}.get("".join(arguments[:1]), "")


if __name__ == "__main__":
    main()
