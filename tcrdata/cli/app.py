"""The program itself, and the parameters that commands share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from cyclopts import App, Parameter

from tcrdata import __version__

StoreUrl = Annotated[str, Parameter(name="--store")]
Assignments = Annotated[tuple[str, ...], Parameter(name="--set", negative="")]
Flag = Annotated[bool, Parameter(negative="")]

app = App(
    name="tcrdata",
    version=__version__,
    help="Trusted 3D labels from unlabelled video: every candidate is a row, every check is SQL.",
    help_epilogue="Every command takes --debug, which shows the traceback of an error.",
    help_format="plaintext",
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
)


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
