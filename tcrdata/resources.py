"""Finds the SQL that ships with tcrdata: `schemas/` and `queries/`."""

from __future__ import annotations

from pathlib import Path

from tcrdata.errors import TcrdataError

_PACKAGE = Path(__file__).resolve().parent


def resource_folder(name: str) -> Path:
    """Return the folder `schemas` or `queries`.

    Looks inside the package first (a wheel), then beside it (a checkout or an editable install).

    Raises:
        TcrdataError: neither place has it.
    """
    for base in (_PACKAGE, _PACKAGE.parent):
        if (base / name).is_dir():
            return base / name
    raise TcrdataError(
        f"the folder '{name}' is neither in {_PACKAGE} nor beside it: reinstall tcrdata"
    )


def resource_files(pattern: str) -> list[Path]:
    """Return the files that match, sorted by name.

    Args:
        pattern: a folder and a glob, such as `queries/rules/*.sql`.
    """
    folder, _, glob = pattern.partition("/")
    return sorted(resource_folder(folder).glob(glob))
