"""What every exporter needs: the chosen labels with their frames, a folder, and a card to read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

import duckdb
import numpy as np
import pyarrow as pa

from tcrdata.errors import MissingEvidenceError, TcrdataError
from tcrdata.exporters.refusals import check_dataset, check_validation, no_labels
from tcrdata.exporters.tracklets import tracklets_as_labels
from tcrdata.exporters.where import keep, lock, readable_tables
from tcrdata.reports import run_report
from tcrdata.store import Store
from tcrdata.store.table_arrays import by_sequence, columns, rows_at, truths, whole_numbers
from tcrdata.types import BOX_COLUMNS, BoolArray, FloatArray, IntArray

_ROWS_AT_A_TIME = 200_000
_READ = ("labels", "selections", "images", "sweeps")
_JUDGED = "judged"  # schema of the tables as the selection read them
_Size = tuple[str, str, int, int, int, int, int]  # a row of exported_sequences.sql


@dataclass(frozen=True)
class ExportOptions:
    """What is exported, and how.

    Attributes:
        where: SQL condition over the columns of `labels`; those that fulfil it are exported.
        ignore: `keep` writes undecided labels as the format's ignore regions, `drop` leaves them.
        category: type written for every object: labels have no class.
        dataset: export this dataset's sequences alone.
        overwrite: write into a folder that is not empty.
        validation: sequences that formats with splits put into their validation split.
        labels_only: write no images and no points, nor links to them.
        tracklets: write what `tcrdata track` made of the labels in their place.
    """

    where: str | None = None
    ignore: Literal["keep", "drop"] = "keep"
    category: str = "Car"
    dataset: str | None = None
    overwrite: bool = False
    validation: tuple[str, ...] = ()
    labels_only: bool = False
    tracklets: bool = False


@dataclass(frozen=True)
class Card:
    """How an export is to be read, and what it holds.

    Attributes:
        format: name of the format.
        out: the folder.
        files: files written.
        labels: positive labels written.
        ignored: undecided labels written as ignore regions.
        conventions: name and meaning: frame, centre, axis order, yaw, units ...
    """

    format: str
    out: str
    files: int
    labels: int
    ignored: int
    conventions: tuple[tuple[str, str], ...]

    def text(self) -> str:
        """Return the card in lines."""
        head = (
            f"{self.format}: {self.labels} labels and {self.ignored} ignore regions "
            f"in {self.files} files under {self.out}"
        )
        width = max(len(name) for name, _ in self.conventions)
        return "\n".join([head, *(f"  {name:<{width}}  {text}" for name, text in self.conventions)])


@dataclass(frozen=True)
class SequenceLabels:
    """One sequence's frames and the labels chosen in it.

    Attributes:
        dataset: the dataset's name.
        sequence: the drive or clip.
        frames: rows of `queries/reports/exported_frames.sql`, sorted by frame; every frame that
            can be read, also those without labels.
        labels: rows of `queries/reports/exported_labels.sql`, sorted by frame, the surest first.
        frame_rows: (N,) row of `frames` of each label.
        beside: the sequence's rows of the report that `ChosenLabels.sequences` was asked for.
    """

    dataset: str
    sequence: str
    frames: pa.Table
    labels: pa.Table
    frame_rows: IntArray
    beside: pa.Table | None = None

    @property
    def root(self) -> str:
        """Where the dataset lies; paths of frames are relative to it."""
        return str(self.frames["root"][0].as_py())

    @property
    def boxes(self) -> FloatArray:
        """(N, 7) x, y, z of the geometric centre, length, width, height, yaw; level frame."""
        return columns(self.labels, BOX_COLUMNS)

    @property
    def positive(self) -> BoolArray:
        """(N,) which labels are positive; the others are ignore regions."""
        return truths(self.labels["positive"])

    def only(self, kept: BoolArray) -> SequenceLabels:
        """Return the same frames with some of the labels, given as (N,) booleans."""
        labels = rows_at(self.labels, np.flatnonzero(kept))
        return replace(self, labels=labels, frame_rows=self.frame_rows[kept])

    def by_frame(self) -> Iterator[tuple[int, slice]]:
        """Yield each row of `frames` with the slice of its labels, an empty one for none."""
        rows = np.arange(self.frames.num_rows + 1)
        edges = np.searchsorted(self.frame_rows, rows).tolist()
        for row in range(self.frames.num_rows):
            yield row, slice(edges[row], edges[row + 1])


class ChosenLabels:
    """The labels that an export is about; made by `chosen_labels`.

    Attributes:
        connection: reads the tables that the selection read, and `labels` as `--where` left it.
        total: positive labels chosen.
        ignored: undecided labels chosen.
        frames: frames, those without labels too.
        images: frames with an image.
        in_images: positive labels that the build placed in an image.
        names: of the sequences, sorted.
        asked: options of a command about the same selection.
    """

    def __init__(
        self,
        connection: duckdb.DuckDBPyConnection,
        selection_id: str,
        options: ExportOptions,
        asked: str,
    ) -> None:
        self.connection, self.asked = connection, asked
        self._selected = {"selection_id": selection_id, "keep_ignored": options.ignore == "keep"}
        only = {"exported_dataset": options.dataset}
        found = run_report(connection, "exported_sequences", {**self._selected, **only})
        self._sizes: list[_Size] = found.fetchall()
        self.frames, self.total, self.ignored, self.images, self.in_images = (
            sum(int(size[column]) for size in self._sizes) for column in (2, 3, 4, 5, 6)
        )
        self.names = sorted({size[1] for size in self._sizes})

    def sequences(
        self,
        beside: str | None = None,
        parameters: Mapping[str, object] | None = None,
        *,
        files: bool = True,
    ) -> Iterator[SequenceLabels]:
        """Yield every sequence that the selection saw, sorted; also those without labels.

        Several short ones are read at a time; never more than fits.

        Args:
            beside: a further report with the parameters of `exported_labels.sql` that choose
                labels and sequences, and with rows sorted by sequence.
            parameters: others of that report.
            files: look up where images and points lie; without, their paths are NULL.
        """
        for dataset, first, last in _groups(self._sizes):
            span = {"first_sequence": first, "last_sequence": last}
            place = {"exported_dataset": dataset, **span}
            frames = run_report(
                self.connection, "exported_frames", {**place, "with_files": files}
            ).to_arrow_table()
            report = run_report(self.connection, "exported_labels", {**self._selected, **place})
            labels = report.to_arrow_table()
            own = by_sequence(labels)
            more: dict[str, pa.Table] = {}
            if beside is not None:
                asked = {**self._selected, **place, **(parameters or {})}
                report = run_report(self.connection, beside, asked)
                more = by_sequence(report.to_arrow_table())
            for sequence, part in by_sequence(frames).items():
                chosen = own.get(sequence, labels.slice(0, 0))
                rows = np.searchsorted(whole_numbers(part["frame"]), whole_numbers(chosen["frame"]))
                yield SequenceLabels(
                    dataset, sequence, part, chosen, rows.astype(np.int64), more.get(sequence)
                )


@contextmanager
def chosen_labels(
    store: Store, selection_id: str, options: ExportOptions, *, splits: bool = False
) -> Iterator[ChosenLabels]:
    """Open a selection's labels for an export.

    Frames and sequences are those of the snapshot that the selection read: what it never judged
    must not look like an empty street.

    Args:
        store: holds the selection.
        selection_id: of the labels.
        options: which labels.
        splits: whether the format has splits of training and validation.

    Raises:
        QueryError: `--where` is no condition on labels.
        SettingsError: no such dataset, or a validation split of other sequences or without splits.
        MissingEvidenceError: there is no such selection, or nothing to export; says why.
    """
    tables = _READ if options.where is None else readable_tables()
    connection = store.connect(tables=[*tables, "tracklets"] if options.tracklets else tables)
    try:
        if options.tracklets:
            tracklets_as_labels(connection, selection_id)
        judged = _selection(connection, selection_id)
        store.add_snapshot(connection, judged["snapshot"], _JUDGED)
        connection.execute(f"set search_path = '{_JUDGED},main'")
        if options.where is not None:
            lock(connection, store.url)
            keep(connection, selection_id, options.where)
            connection.execute(f"set search_path = 'chosen,{_JUDGED},main'")
        names = connection.sql("select distinct dataset from sequences order by all").fetchall()
        check_dataset([name for (name,) in names], options)
        asked = f"--store {store.url} --selection {selection_id}"
        chosen = ChosenLabels(connection, selection_id, options, asked)
        if not chosen.total:
            raise no_labels(judged, options, asked)
        check_validation(chosen.names, options, splits=splits)
        yield chosen
    finally:
        connection.close()


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


def _selection(connection: duckdb.DuckDBPyConnection, selection_id: str) -> dict[str, Any]:
    rows = connection.execute(
        "select selection_id, snapshot, proposals_judged, labels, ignored from selections "
        "where selection_id = ?",
        [selection_id],
    )
    names = [column[0] for column in rows.description or ()]
    found = [dict(zip(names, row, strict=True)) for row in rows.fetchall()]
    if not found:
        raise MissingEvidenceError(
            f"there is no selection '{selection_id}': "
            'list them with `tcrdata sql "select selection_id, name, labels from selections"`'
        )
    return found[0]


def _groups(
    sizes: Sequence[_Size],
) -> Iterator[tuple[str, str, str]]:
    """Yield a dataset with its first and last sequence to be read at a time."""
    for dataset, of_dataset in groupby(sizes, key=lambda size: size[0]):
        names: list[str] = []
        rows = 0
        for _, sequence, frames, labels, ignored, *_ in of_dataset:
            rows += frames + labels + ignored
            names.append(sequence)
            if rows >= _ROWS_AT_A_TIME:
                yield dataset, names[0], names[-1]
                names, rows = [], 0
        if names:
            yield dataset, names[0], names[-1]
