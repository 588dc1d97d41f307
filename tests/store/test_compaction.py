"""Bundles hold what their files hold, and stand in for them when all are asked for."""

from __future__ import annotations

from pathlib import Path

import pytest
from store_files import digests

from tcrdata.store import Store, Unit, open_store


@pytest.fixture(params=["file", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    url = str(tmp_path / "s") if request.param == "file" else f"memory://{tmp_path.name}"
    store = open_store(url, create=True)
    for number in range(5):
        put(store, f"{number:02d}", "tracks", number + 1)
    put(store, "00", "static_clusters", 3)
    return store


def put(store: Store, sequence: str, stage: str, rows: int) -> None:
    with store.writer(Unit(stage, "d", sequence, 1), settings_hash="x", inputs={}) as writer:
        writer.append(
            "confidences",
            {
                "proposal_id": [f"d/{sequence}/{stage}/{n}" for n in range(rows)],
                "frame": list(range(rows)),
                "module": ["m"] * rows,
                "confidence": [n / 10 for n in range(rows)],
                "unit": ["share"] * rows,
            },
        )


def rows_of(store: Store) -> list[tuple[object, ...]]:
    query = "from confidences order by proposal_id"
    return store.connect(tables=["confidences"]).execute(query).fetchall()


def sources(store: Store) -> str:
    query = "select sql from duckdb_views() where view_name = 'confidences'"
    return str(store.connect(tables=["confidences"]).execute(query).fetchall()[0][0])


def test_a_bundle_holds_the_rows_of_its_files(store: Store) -> None:
    before = rows_of(store)
    (bundle,) = store.compact()  # one file of another stage stays by itself
    assert (bundle.table, bundle.rows, len(bundle.holds)) == ("confidences", 15, 5)
    assert rows_of(store) == before
    assert store.read("confidences").num_rows == 18
    assert [again.path for again in store.compact()] == [bundle.path]


def test_queries_read_the_bundle_and_files_that_came_later(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "s"), create=True)
    for number in range(3):
        put(store, f"{number}", "tracks", 2)
    frozen = store.freeze(tables=["confidences"])
    store.compact()
    put(store, "9", "tracks", 4)
    assert len(rows_of(store)) == 10
    assert sources(store).count(".parquet") == 2
    assert sources(store).count("compacted/") == 1
    old = store.connect(snapshot=frozen.name, tables=["confidences"])
    assert old.execute("select count(*) from confidences").fetchall() == [(6,)]


def test_a_file_that_was_made_anew_is_not_read_from_an_old_bundle(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "s"), create=True)
    for number in range(3):
        put(store, f"{number}", "tracks", 2)
    store.compact()
    with store.writer(Unit("tracks", "d", "1", 1), settings_hash="y", inputs={}) as writer:
        writer.append("confidences", {})
    assert len(rows_of(store)) == 4
    assert "compacted/" not in sources(store)


def test_compacting_adds_bundles_and_changes_nothing_else(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "s"), create=True)
    for number in range(3):
        put(store, f"{number}", "tracks", 2)
    before = digests(tmp_path / "s")
    store.compact()
    after = digests(tmp_path / "s")
    assert {path: after[path] for path in before} == before
    assert {path.split("/")[0] for path in set(after) - set(before)} == {"compacted"}
