"""A store of other tables than this version's is refused in one line that says what to do."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from store_rows import UNIT, commit, confidences

from tcrdata.errors import SchemaError
from tcrdata.store import open_store, schemas

WHAT_TO_DO = "build into a new store, or use the tcrdata that made it"


@pytest.fixture
def description(disk) -> Path:
    return Path(disk.url) / "store.json"


@pytest.mark.parametrize("version", [schemas.SCHEMA_VERSION - 1, 99])
def test_an_older_or_newer_version_is_refused_with_both_versions(disk, description, version):
    description.write_text(json.dumps({"schema_version": version}))
    both = f"has schema version {version}, this tcrdata reads {schemas.SCHEMA_VERSION}: "
    with pytest.raises(SchemaError, match=both + WHAT_TO_DO):
        open_store(disk.url)


def test_a_table_that_changed_without_its_version_is_refused_by_name(disk, description):
    content = json.loads(description.read_text())
    assert content["tables"] == schemas.fingerprints()
    assert "checks" not in content["tables"]
    content["tables"] |= {"labels": "0", "frames": "1"}
    description.write_text(json.dumps(content))
    with pytest.raises(
        SchemaError, match=f"tables frames, labels had other columns .*{WHAT_TO_DO}"
    ):
        open_store(disk.url, create=True)


def test_a_table_that_only_one_of_both_knows_does_no_harm(disk, description):
    content = json.loads(description.read_text())
    del content["tables"]["models"]
    content["tables"]["radar"] = "0123"
    description.write_text(json.dumps(content))
    commit(disk, confidences=confidences(2))
    assert open_store(disk.url).read("confidences").num_rows == 2


@pytest.fixture
def fingerprint_of(monkeypatch, tmp_path) -> Iterator[Callable[..., str]]:
    """The fingerprint of a table with these columns."""
    path = tmp_path / "t.sql"
    monkeypatch.setattr(schemas, "resource_files", lambda _: [path])

    def made_of(*columns: str) -> str:
        lines = ",\n    ".join(columns)
        path.write_text(f"-- A table.\ncreate table t (\n    {lines}\n);\n")
        schemas._tables.cache_clear()
        return schemas.fingerprints()["t"]

    yield made_of
    schemas._tables.cache_clear()


def test_a_fingerprint_tells_columns_types_and_nulls_apart_but_no_order(fingerprint_of):
    known = {
        fingerprint_of("a varchar not null", "b double"),
        fingerprint_of("a varchar", "b double"),
        fingerprint_of("a varchar not null", "b integer"),
        fingerprint_of("a varchar not null", "c double"),
        fingerprint_of("a varchar not null", "b double", "c double"),
    }
    assert len(known) == 5
    assert fingerprint_of("b double", "a varchar not null") in known


def test_a_file_without_a_column_is_no_raw_message(disk, description):
    """Of stores that were made before fingerprints were kept."""
    commit(disk, UNIT, confidences=confidences(2))
    description.write_text(json.dumps({"schema_version": schemas.SCHEMA_VERSION}))
    (path,) = Path(disk.url).glob("data/confidences/**/*.parquet")
    pq.write_table(pq.read_table(path).drop_columns(["unit"]), path)
    record = next(Path(disk.url).glob("commits/**/*.json"))
    content = json.loads(record.read_text())
    content["files"][0]["bytes"] = path.stat().st_size
    record.write_text(json.dumps(content))
    old = open_store(disk.url)
    with pytest.raises(
        SchemaError, match=f"table confidences in .* has other .*{WHAT_TO_DO}"
    ) as told:
        old.connect(tables=["confidences"])
    assert "\n" not in str(told.value)
    with pytest.raises(SchemaError, match=rf"\(no unit\): {WHAT_TO_DO}"):
        old.read("confidences")
