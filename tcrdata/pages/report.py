"""The report of a selection: one page that opens anywhere and asks no network."""

from __future__ import annotations

import contextlib
import itertools
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tcrdata.errors import SettingsError
from tcrdata.pages import sections
from tcrdata.pages.gallery import gallery
from tcrdata.pages.reading import Reading, read_selection
from tcrdata.pages.rule_sheets import RuleBook, parameter_table, rule_book, rule_sheets
from tcrdata.pages.scores import Scores, read_scores, score_section
from tcrdata.pages.summary import masthead
from tcrdata.store import Store
from tcrdata.views.report.cards import Card
from tcrdata.views.report.document import Section, document


@dataclass(frozen=True)
class Report:
    """A report that was written.

    Attributes:
        path: the file.
        bytes: its size.
        examples: candidates in the gallery.
        pictures: of them, those cut out of a camera image.
        scored: ground truth was there.
    """

    path: str
    bytes: int
    examples: int
    pictures: int
    scored: bool


def write_report(
    store: Store, selection_id: str, out: str | Path, sequences: Sequence[str] | None = None
) -> Report:
    """Write the report of a selection; a file that is there is replaced at once, or not at all.

    Args:
        store: holds the selection. Its dataset need not be there: pictures then say why not.
        selection_id: what to report on.
        out: the HTML file.
        sequences: these drives alone; None for all.

    Raises:
        MissingEvidenceError: there is no such selection or drive.
        SettingsError: the file cannot be written.
    """
    path = Path(out)
    if path.is_dir():
        raise SettingsError(f"--out {out}: is a folder: give the name of an .html file")
    with tempfile.TemporaryDirectory(prefix="tcrdata-") as spill:
        reading = read_selection(store, selection_id, sequences, Path(spill))
        try:
            page, report = _page(reading, path)
        finally:
            reading.connection.close()
    _write(path, page)
    return report


def _page(reading: Reading, path: Path) -> tuple[bytes, Report]:
    scores = read_scores(reading)
    book = rule_book(reading.selection)
    examples = gallery(reading)
    (row,) = reading.selected("report_selection")
    head = masthead(reading, row, scores, book)
    parts = _sections(reading, scores, book, examples)
    title = f"{row['name']}: label report"
    page = document(title, head, parts, sections.footer(reading)).encode()
    cards = list(itertools.chain.from_iterable(examples.values()))
    pictured = sum("<image" in card.camera for card in cards)
    return page, Report(str(path), len(page), len(cards), pictured, not isinstance(scores, str))


def _sections(
    reading: Reading, scores: Scores | str, book: RuleBook, examples: dict[str, list[Card]]
) -> list[Section]:
    """The parts below the head, in order."""
    chosen = reading.selection
    return [
        Section(name, short, title, lead, content)
        for name, short, title, lead, content in (
            ("funnel", "Funnel", "Which rule decides what", sections.FUNNEL,
             sections.funnel(reading, book)),
            ("scores", "Scores", "Scores against ground truth", sections.SCORES,
             score_section(scores)),
            ("labels", "Labels", "What the labels are like", sections.LABELS,
             sections.labels(reading)),
            ("tracks", "Tracks", "Tracks over time", sections.TRACKS, sections.tracks(reading)),
            ("gallery", "Gallery", "Gallery", sections.GALLERY,
             sections.examples(examples, book.words())),
            ("rules", "Rules", "The rules, as SQL", sections.RULES, rule_sheets(chosen, book)),
            ("parameters", "Parameters", "Parameters", sections.PARAMETERS,
             parameter_table(chosen, book)),
            ("left-out", "Left out", "What was left out", sections.LEFT_OUT,
             sections.left_out(reading)),
        )
    ]  # fmt: skip


def _write(path: Path, page: bytes) -> None:
    """Write beside the file, then take its place."""
    beside = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(page)
        beside.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        raise SettingsError(
            f"--out {path}: {error.strerror}: give a file that can be written"
        ) from error
