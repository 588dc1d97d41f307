"""The program itself, and the parameters that commands share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from cyclopts import App, Parameter

from tcrdata import __version__
from tcrdata.cli.overview import ABOUT, COMMANDS, EPILOGUE, GROUPS

StoreUrl = Annotated[str, Parameter(name="--store")]
Assignments = Annotated[tuple[str, ...], Parameter(name="--set", negative="")]
Flag = Annotated[bool, Parameter(negative="")]

app = App(
    name="tcrdata",
    version=__version__,
    help=ABOUT,
    help_epilogue=EPILOGUE,
    help_format="plaintext",
    print_error=False,
    exit_on_error=False,
    suppress_keyboard_interrupt=False,
    result_action="return_value",
)
# Named, not imported: a command waits for no module but its own, and the list of all for none.
for _command in COMMANDS:
    app.command(f"tcrdata.cli.{_command}:{_command}")
for _command in GROUPS:
    app.command(f"tcrdata.cli.groups:{_command}_commands", name=_command)


def group(command: Callable[..., int], **others: Callable[..., int]) -> App:
    """Return a command that has others below it: `tcrdata train`, and `tcrdata train flow`."""
    own = App(name=command.__name__, help_format="plaintext")
    own.default(command)
    for name, other in others.items():
        own.command(other, name=name)
    return own


def listed(text: str | None) -> tuple[str, ...] | None:
    """Return the parts of a text with commas between; None stays None."""
    if text is None:
        return None
    return tuple(part.strip() for part in text.split(",") if part.strip())
