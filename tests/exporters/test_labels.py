"""Which labels and frames an export is about."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from label_worlds import box, columns_of, frame_row, label_row, make_store, sequence_row

from tcrdata.errors import MissingEvidenceError, SettingsError, TcrdataError
from tcrdata.exporters import labels as shared
from tcrdata.exporters.labels import ExportOptions, chosen_labels, open_folder
from tcrdata.store import Store, Unit
from tcrdata.store.table_arrays import matrices

LABELS = [
    label_row("b", 2, "b1", 0.9, track_id="t", **box(0, 10)),
    label_row("b", 0, "b2", 0.7, **box(0, 10)),
    label_row("b", 0, "b3", 0.8, track_id="t", **box(3, 10)),
    label_row("a", 1, "a1", 0.4, state="ignore", track_id="t", **box(0, 10)),
    label_row("a", 1, "a2", 0.3, track_id="t", **box(0, 10)),
]


def store_of(name: str, labels: list[dict[str, Any]], dataset: str = "kitti") -> Store:
    frames = [
        frame_row(s, n, "error" if (s, n) == ("a", 2) else "ok") for s in "abc" for n in (0, 1, 2)
    ]
    sequences = [sequence_row(s) for s in "abc"]
    return make_store(name, dataset, sequences=sequences, frames=frames, labels=labels)


def found(store: Store, options: ExportOptions | None = None) -> dict[str, list[tuple[int, str]]]:
    with chosen_labels(store, "s1", options or ExportOptions()) as chosen:
        result = {}
        for part in chosen.sequences():
            frames = part.labels["frame"].to_pylist()
            names = part.labels["proposal_id"].to_pylist()
            result[part.sequence] = list(zip(frames, names, strict=True))
            assert part.frames["frame"].to_numpy()[part.frame_rows].tolist() == frames
        return result


def test_labels_come_by_sequence_and_frame_and_frames_without_labels_too() -> None:
    store = store_of("chosen", LABELS)
    assert found(store) == {
        "a": [(1, "a1"), (1, "a2")],
        "b": [(0, "b3"), (0, "b2"), (2, "b1")],
        "c": [],
    }
    with chosen_labels(store, "s1", ExportOptions()) as chosen:
        assert (chosen.total, chosen.ignored, chosen.frames) == (4, 1, 8)
        parts = list(chosen.sequences())
    assert [part.frames["frame"].to_pylist() for part in parts] == [[0, 1], [0, 1, 2], [0, 1, 2]]
    assert list(parts[1].by_frame()) == [(0, slice(0, 2)), (1, slice(2, 2)), (2, slice(2, 3))]
    assert parts[0].positive.tolist() == [False, True]
    assert parts[0].labels["track_number"].to_pylist() == [None, 0]
    assert parts[1].labels["track_number"].to_pylist() == [0, 1, 0]


def test_reading_few_rows_at_a_time_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    store = store_of("groups", LABELS)
    whole = found(store)
    monkeypatch.setattr(shared, "_ROWS_AT_A_TIME", 1)
    assert found(store) == whole


def test_undecided_labels_can_be_dropped() -> None:
    store = store_of("dropped", LABELS)
    assert found(store, ExportOptions(ignore="drop"))["a"] == [(1, "a2")]


def test_sequences_that_the_selection_never_saw_are_no_empty_streets() -> None:
    store = store_of("later", LABELS)
    with store.writer(Unit("ingest", "kitti", "d", 1), settings_hash="0", inputs={}) as writer:
        writer.append("sequences", columns_of([sequence_row("d")]))
        writer.append("frames", columns_of([frame_row("d", 0)]))
    assert list(found(store)) == ["a", "b", "c"]


def test_nothing_to_export_says_why() -> None:
    with (
        pytest.raises(
            MissingEvidenceError,
            match=r"no positive labels .* funnel --store memory",
        ),
        chosen_labels(store_of("none", [LABELS[3]]), "s1", ExportOptions()),
    ):
        pass
    with (
        pytest.raises(SettingsError, match="read nothing of 'demo': there is kitti"),
        chosen_labels(store_of("other", LABELS), "s1", ExportOptions(dataset="demo")),
    ):
        pass
    with (
        pytest.raises(MissingEvidenceError, match="no selection 's9'"),
        chosen_labels(store_of("unknown", LABELS), "s9", ExportOptions()),
    ):
        pass


def test_matrices_of_frames_without_a_camera_are_nan() -> None:
    store = store_of("matrices", LABELS)
    with chosen_labels(store, "s1", ExportOptions()) as chosen:
        frames = next(chosen.sequences()).frames
    projection = matrices(frames, "projection", (3, 4))
    assert projection.shape == (2, 3, 4)
    np.testing.assert_array_equal(projection[0], [[700, 0, 600, 0], [0, 700, 180, 0], [0, 0, 1, 0]])
    none = frames.set_column(
        frames.column_names.index("projection"), "projection", [[None, [1.0] * 12]]
    )
    assert np.isnan(matrices(none, "projection", (3, 4))[0]).all()


def test_a_folder_that_is_not_empty_is_refused(tmp_path: Path) -> None:
    assert open_folder(tmp_path / "new" / "deep", overwrite=False).is_dir()
    (tmp_path / "file").write_text("")
    with pytest.raises(TcrdataError, match=r"not empty.*--overwrite"):
        open_folder(tmp_path, overwrite=False)
    assert open_folder(tmp_path, overwrite=True) == tmp_path
    with pytest.raises(TcrdataError, match="cannot be made a folder"):
        open_folder(tmp_path / "file", overwrite=True)
