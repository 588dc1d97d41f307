"""A user's condition filters labels, and can do nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import label_worlds
import pytest
from label_worlds import box, frame_row, label_row, make_store, sequence_row
from store_files import digests

from tcrdata.errors import MissingEvidenceError, QueryError
from tcrdata.exporters.labels import ExportOptions, chosen_labels
from tcrdata.store import Store, open_store


@pytest.fixture(params=["local", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    """Three labels in frames 0 to 2 with scores 0.5, 0.6 and 0.7, in a folder of an odd name."""
    name = f"where_{request.node.name}"
    if request.param == "local":
        real = open_store

        def local(_: str, create: bool) -> Store:
            return real(str(tmp_path / "a [b]* it's"), create=create)

        monkeypatch.setattr(label_worlds, "open_store", local)
    rows: list[dict[str, Any]] = [
        label_row("0000", n, f"p{n}", 0.5 + n / 10, **box(n, 10)) for n in range(3)
    ]
    frames = [frame_row("0000", n) for n in range(3)]
    return make_store(name, sequences=[sequence_row("0000")], frames=frames, labels=rows)


def kept(store: Store, condition: str) -> list[str]:
    with chosen_labels(store, "s1", ExportOptions(where=condition)) as chosen:
        return [
            name for part in chosen.sequences() for name in part.labels["proposal_id"].to_pylist()
        ]


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("score > 0.55", ["p1", "p2"]),
        ("proposal_id like 'p2%' -- the last one", ["p2"]),
        ("frame in (select max(frame) from labels)", ["p2"]),
        ("frame in (with f as (from frames) select frame from f where frame < 2)", ["p0", "p1"]),
        ("labels.x_m between 0.5 and 1.5 or score = 0.5", ["p0", "p1"]),
    ],
)
def test_a_condition_filters(store: Store, condition: str, expected: list[str]) -> None:
    assert kept(store, condition) == expected


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("", "is empty"),
        ("  ", "is empty"),
        ("score >", "no condition on labels: syntax error"),
        ("score > 0.5;", "no condition on labels: syntax error"),
        ("1; drop table labels", "no condition on labels: syntax error"),
        ("drop table labels", r"is a statement \(drop\)"),
        ("delete from labels", r"is a statement \(delete\)"),
        ("copy labels to 'stolen.csv'", r"is a statement \(copy\)"),
        ("attach 'stolen.db'", r"is a statement \(attach\)"),
        ("set enable_external_access = true", r"is a statement \(set\)"),
        ("true) union select * from labels where (true", "more than one condition"),
        ("true) limit (1", "more than one condition"),
        ("true) group by all having (true", "more than one condition"),
        ("score", "is double, not true or false"),
        ("colour = 'red'", '"colour" not found'),
        ("count(*) > 3", "cannot contain aggregates"),
        ("cast(source as integer) > 3", "Could not convert string 'track'"),
        ("frame in (select frame from checks)", "checks does not exist"),
        ("frame in (select frame from ground_truth)", "ground_truth does not exist"),
        ("frame in (select frame from truth_tracklets)", "truth_tracklets does not exist"),
        ("exists(from '/etc/passwd')", "does not exist"),
        ("exists(from read_text('/etc/passwd'))", "Cannot access file"),
        ("exists(from read_csv('/etc/passwd'))", "Cannot access file"),
        ("exists(from glob('/etc/*'))", "Cannot access file"),
        ("exists(from sniff_csv('/etc/passwd'))", "Cannot access file"),
        ("score > (delete from labels returning 1)", "no condition on labels"),
        ("? > 1", "no condition on labels"),
    ],
)
def test_what_is_no_condition_is_refused_in_a_line(
    store: Store, condition: str, message: str
) -> None:
    with pytest.raises(QueryError, match=message) as caught:
        kept(store, condition)
    assert "\n" not in str(caught.value)


def test_a_condition_that_nothing_fulfils(store: Store) -> None:
    with pytest.raises(
        MissingEvidenceError, match=r"--where 'score > 2' keeps no positive.*funnel"
    ):
        kept(store, "score > 2")


def test_no_condition_reads_a_file_of_the_truth(tmp_path: Path) -> None:
    frames, labels = [frame_row("0000", 0)], [label_row("0000", 0, "p", 0.5, **box(0, 10))]
    real = open_store(str(tmp_path / "store"), create=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(label_worlds, "open_store", lambda _, create: real)
        store = make_store("x", sequences=[sequence_row("0000")], frames=frames, labels=labels)
    (own,) = (tmp_path / "store/data/labels").rglob("*.parquet")
    assert kept(store, f"exists(from read_parquet('{own}'))") == ["p"]
    truth = own.parents[3] / "ground_truth" / own.name
    truth.parent.mkdir()
    truth.write_bytes(own.read_bytes())
    with pytest.raises(QueryError, match="Cannot access file"):
        kept(store, f"exists(from read_parquet('{truth}'))")


def test_no_condition_touches_the_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = open_store
    monkeypatch.setattr(
        label_worlds, "open_store", lambda _, create: real(str(tmp_path / "store"), create=create)
    )
    frames, labels = [frame_row("0000", 0)], [label_row("0000", 0, "p", 0.5, **box(0, 10))]
    store = make_store("x", sequences=[sequence_row("0000")], frames=frames, labels=labels)
    before = digests(tmp_path / "store")
    for text in ("true", "copy labels to 'x'", "exists(from query('copy labels to ''x'''))"):
        try:
            kept(store, text)
        except QueryError:
            continue
    assert digests(tmp_path / "store") == before
