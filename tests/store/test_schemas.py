"""Every table of `schemas/` is understood, and its rows go in and come out."""

from __future__ import annotations

import duckdb
import pyarrow as pa
import pytest
from store_rows import UNIT, commit, confidences

from tcrdata.errors import SchemaError
from tcrdata.store import Unit, open_store, schemas

WRITTEN = [table for table in schemas.table_names() if not schemas.is_view(table)]
VALUES = {
    pa.string(): "a 'b' ü",
    pa.binary(): b"\x00\xff",
    pa.bool_(): True,
    pa.int32(): 7,
    pa.int64(): 2**60,
    pa.float64(): 0.1,
}


def value(kind, own=None):
    if own is not None:
        return own
    if pa.types.is_list(kind):
        return [value(kind.value_type)] * 3
    if pa.types.is_map(kind):
        return [("k", value(kind.item_type))]
    if pa.types.is_struct(kind):
        return {field.name: value(field.type) for field in kind}
    return VALUES[kind]


@pytest.mark.parametrize("table", WRITTEN)
@pytest.mark.parametrize("url", ["file", "memory"])
def test_every_table_round_trips(table, url, tmp_path):
    store = open_store(str(tmp_path) if url == "file" else f"memory://round/{table}", create=True)
    schema = schemas.arrow_schema(table)
    own = {"dataset": "kitti", "sequence": "0001", "round": 1}
    full = {field.name: value(field.type, own.get(field.name)) for field in schema}
    bare = {f.name: None if f.nullable else full[f.name] for f in schema}
    commit(store, UNIT, **{table: {name: [full[name], bare[name]] for name in schema.names}})
    rows = store.read(table)
    assert rows.schema == schema
    assert rows.to_pylist() == [full, bare]
    connection = store.connect(tables=[table])
    assert connection.execute(f"select count(*) from {table}").fetchall() == [(2,)]
    queried = connection.sql(f"from {table}").to_arrow_table()
    assert queried.column_names == schema.names
    assert store.scan(table).collect().height == 2


def test_the_weights_are_those_of_the_design():
    heavy = {table for table in schemas.table_names() if schemas.is_heavy(table)}
    assert heavy == {"images", "sweeps", "flows", "point_evidence", "weights"}
    assert [table for table in schemas.table_names() if schemas.is_view(table)] == [
        "checks",
        "verdicts",
    ]


@pytest.mark.parametrize("table", schemas.table_names())
def test_every_column_has_a_comment_and_its_type(table):
    found = schemas.columns(table)
    assert [column.name for column in found] == schemas.arrow_schema(table).names
    assert all(column.comment for column in found)
    assert "create table" in schemas.ddl(table)


def test_tables_are_read_as_duckdb_reads_them():
    with duckdb.connect() as connection:
        for table in schemas.table_names():
            connection.execute(schemas.ddl(table))
        rows = connection.execute(
            "select table_name, column_name, lower(data_type), is_nullable from duckdb_columns() "
            "where not internal order by table_name, column_index"
        ).fetchall()
    assert rows == [
        (table, column.name, column.type, schemas.arrow_schema(table).field(column.name).nullable)
        for table in schemas.table_names()
        for column in schemas.columns(table)
    ]


def test_comments_and_types_are_read_from_the_ddl():
    by_name = {column.name: column for column in schemas.columns("proposals")}
    assert by_name["x_m"] == ("x_m", "double", "geometric centre")
    assert schemas.arrow_schema("runs").field("packages").type == pa.map_(pa.string(), pa.string())
    assert schemas.arrow_schema("images").metadata[b"huggingface"].startswith(b'{"info"')


def test_an_unknown_table_is_named(store):
    with pytest.raises(SchemaError, match="no table 'proposal': the tables are cal"):
        store.files("proposal")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"confidense": [1.0]}, "table confidences has no column confidense: its columns are "),
        ({"module": None}, "table confidences, column module: missing, but it is not null"),
        ({"module": [None]}, "column module: NULL or NaN in row 0, but it is not null"),
        ({"frame": [1.5]}, "table confidences, column frame: not int32 .1.5 is not whole"),
        ({"frame": ["one"]}, "table confidences, column frame: not int32"),
        ({"confidence": ["high"]}, "table confidences, column confidence: not double"),
        ({"unit": [3]}, "table confidences, column unit: not string"),
        ({"frame": [2**40]}, "table confidences, column frame: not int32"),
        ({"frame": [1, 2]}, "table confidences: columns differ in length: .*frame 2"),
        ({"sequence": ["0002"]}, "column sequence: '0002' is not the unit's '0001'"),
    ],
)
def test_rows_that_do_not_fit_are_refused(store, change, message):
    columns = {**confidences(1), **change}
    columns = {name: values for name, values in columns.items() if values is not None}
    with pytest.raises(SchemaError, match=message):
        commit(store, confidences=columns)
    assert store.records() == []
    assert store.read("confidences").num_rows == 0


def test_a_view_is_never_written(store):
    with pytest.raises(SchemaError, match="table checks is a view"):
        commit(store, checks={})


def test_nan_becomes_null_because_sql_calls_it_larger_than_every_bound(store):
    commit(store, confidences=confidences(1, confidence=float("nan")))
    assert store.read("confidences", columns=["confidence"]).to_pylist() == [{"confidence": None}]


def test_units_of_any_dataset_carry_their_rows_keys(store):
    keys = {"dataset": ["kitti", "demo"], "sequence": ["a", "b"], "round": [1, 1]}
    commit(store, Unit("selection", "_", "id1", 1), confidences={**confidences(2), **keys})
    assert store.read("confidences", dataset="demo", columns=["sequence"]).to_pylist() == [
        {"sequence": "b"}
    ]
    assert store.tables("kitti", "a", 1).read("confidences").num_rows == 1
    assert store.read("confidences", dataset="_", sequence="id1").num_rows == 2
