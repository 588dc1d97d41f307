"""What every exporter needs: a folder to write to, a card that says how to read what is in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import duckdb

from tcrdata.errors import MissingEvidenceError, TcrdataError


@dataclass(frozen=True)
class Card:
    """How an export is to be read, and what it holds.

    Attributes:
        format: name of the format.
        out: the folder.
        files: files written.
        labels: labels written.
        conventions: name and meaning: frame, centre, axis order, yaw, units ...
    """

    format: str
    out: str
    files: int
    labels: int
    conventions: tuple[tuple[str, str], ...]

    def text(self) -> str:
        """Return the card in lines."""
        head = f"{self.format}: {self.labels} labels in {self.files} files under {self.out}"
        width = max(len(name) for name, _ in self.conventions)
        return "\n".join([head, *(f"  {name:<{width}}  {text}" for name, text in self.conventions)])


def open_folder(out: str | Path, overwrite: bool) -> Path:
    """Return the folder to write to, made if absent.

    Raises:
        TcrdataError: it is a file, it cannot be made, or it is not empty.
    """
    folder = Path(out)
    try:
        if folder.is_dir() and not overwrite and any(folder.iterdir()):
            raise TcrdataError(f"{folder} is not empty: choose another --out, or add --overwrite")
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TcrdataError(f"{folder} cannot be made a folder: {error.strerror}") from error
    return folder


def no_labels(connection: duckdb.DuckDBPyConnection, selection_id: str) -> MissingEvidenceError:
    """Return the error of an empty export: why there is nothing, and where to look."""
    judged = connection.execute(
        "select proposals_judged, labels from selections where selection_id = ?", [selection_id]
    ).fetchone()
    if judged is None:
        return MissingEvidenceError(
            f"there is no selection '{selection_id}': "
            'list them with `tcrdata sql "select selection_id, name, labels from selections"`'
        )
    judging = f"select rule, count(*) from checks where selection_id = '{selection_id}'"
    return MissingEvidenceError(
        f"selection '{selection_id}' has no positive labels to export "
        f"({judged[0]} proposals judged, {judged[1]} labels of any state): see which rule drops "
        f'them with `tcrdata sql "{judging} and passed is distinct from true group by rule"`'
    )
