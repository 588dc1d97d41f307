"""`python -m tcrdata`, and the command `tcrdata`.

Worker processes import this module as their own main module: it loads nothing until it is run.
"""

from __future__ import annotations

from typing import NoReturn


def main() -> NoReturn:
    """Run the command that the arguments of this process name."""
    from tcrdata import cli

    cli.main()


if __name__ == "__main__":
    main()
