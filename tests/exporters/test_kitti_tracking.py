"""The export read back by a parser of its own, and one box worked out by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from label_worlds import (
    IDENTITY,
    box,
    frame_row,
    label_row,
    make_store,
    sequence_row,
    truth_row,
)

from tcrdata.errors import MissingEvidenceError, TcrdataError
from tcrdata.evaluation.scoring import evaluate
from tcrdata.exporters.kitti_tracking import export
from tcrdata.exporters.labels import ExportOptions

_names = iter(range(1000))
NO_BOX = dict.fromkeys(("left_px", "top_px", "right_px", "bottom_px"))


def store_of(labels: list[dict[str, Any]], camera_T_level: list[float] | None = None) -> Any:
    frames = [
        frame_row(sequence, number) | {"camera_T_level": camera_T_level or IDENTITY}
        for sequence in ("0000", "0001")
        for number in range(3)
    ]
    return make_store(
        f"export{next(_names)}",
        sequences=[sequence_row("0000"), sequence_row("0001")],
        frames=frames,
        labels=labels,
    )


def parse(path: Path) -> list[dict[str, Any]]:
    """Read tracking results as KITTI's development kit describes them."""
    rows = []
    for line in path.read_text().splitlines():
        fields = line.split(" ")
        assert len(fields) == 18
        numbers = [float(field) for field in fields[5:]]
        rows.append(
            {
                "frame": int(fields[0]),
                "track": int(fields[1]),
                "type": fields[2],
                "truncated": int(fields[3]),
                "occluded": int(fields[4]),
                "alpha": numbers[0],
                "box_2d": numbers[1:5],
                "hwl": numbers[5:8],
                "xyz": numbers[8:11],
                "ry": numbers[11],
                "score": numbers[12],
            }
        )
    return rows


def geometric(row: dict[str, Any]) -> list[float]:
    """Back to x, y, z, length, width, height, yaw of the level frame (camera = level)."""
    height, width, length = row["hwl"]
    x, y, z = row["xyz"]
    return [x, y - height / 2, z, length, width, height, row["ry"]]


def test_one_box_by_hand(tmp_path: Path) -> None:
    place = {
        "x_m": 10.0,
        "y_m": 0.75,
        "z_m": 10.0,
        "length_m": 4.0,
        "width_m": 2.0,
        "height_m": 1.5,
        "yaw_rad": -math.pi / 2,  # straight ahead
        "left_px": 100.0,
        "top_px": 50.5,
        "right_px": 200.0,
        "bottom_px": 150.0,
        "truncated_share": 0.2,
        "occluded_share": 0.6,
    }
    card = export(store_of([label_row("0000", 2, "p", 0.875, **place)]), "s1", tmp_path / "out")
    text = (tmp_path / "out" / "label_02" / "0000.txt").read_text()
    assert text == (
        "2 0 Car 1 2 -2.356194 100.000000 50.500000 200.000000 150.000000 "
        "1.500000 2.000000 4.000000 10.000000 1.500000 10.000000 -1.570796 0.875000\n"
    )
    assert (card.labels, card.files) == (1, 2)
    assert "bottom centre" in card.text()


def test_round_trip(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    labels = [
        label_row("0000", n % 3, f"p{n:02d}", float(random.random()), track_id=f"t{n % 5}")
        | box(float(random.uniform(-9, 9)), float(random.uniform(3, 30)))
        | {"yaw_rad": float(random.uniform(-math.pi, math.pi))}
        for n in range(15)
    ]
    export(store_of(labels), "s1", tmp_path)
    rows = parse(tmp_path / "label_02" / "0000.txt")
    names = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
    expected = sorted(
        [label["frame"], -label["score"], *(label[n] for n in names)] for label in labels
    )
    got = sorted([row["frame"], -row["score"], *geometric(row)] for row in rows)
    np.testing.assert_allclose(got, expected, atol=1e-4)
    assert len({row["track"] for row in rows}) == 5
    assert all(-math.pi <= row["alpha"] <= math.pi for row in rows)
    assert (tmp_path / "label_02" / "0001.txt").read_text() == ""


def test_tracks_are_whole_numbers_and_unique_in_a_frame(tmp_path: Path) -> None:
    labels = [
        label_row("0000", 0, "a", 0.9, track_id="long/0001", **box(0, 10)),
        label_row("0000", 0, "b", 0.8, track_id="long/0001", **box(3, 10)),
        label_row("0000", 1, "c", 0.9, track_id="long/0001", **box(0, 10)),
        label_row("0000", 1, "d", 0.7, **box(3, 10)),
    ]
    export(store_of(labels), "s1", tmp_path)
    rows = parse(tmp_path / "label_02" / "0000.txt")
    assert [(row["frame"], row["track"]) for row in rows] == [(0, 0), (0, 1), (1, 0), (1, 2)]


def test_boxes_without_pixels_are_projected_or_minus_one(tmp_path: Path) -> None:
    labels = [
        label_row("0000", 0, "ahead", 0.9, **(box(0, 10) | NO_BOX)),
        label_row("0000", 0, "behind", 0.8, **(box(0, 10) | NO_BOX | {"z_m": -10.0})),
    ]
    export(store_of(labels), "s1", tmp_path)
    ahead, behind = parse(tmp_path / "label_02" / "0000.txt")
    # The near face stands at z = 9 m, 4 m wide, from y = 0.25 m to 1.75 m.
    expected = [600 - 700 * 2 / 9, 180 + 700 * 0.25 / 11, 600 + 700 * 2 / 9, 180 + 700 * 1.75 / 9]
    assert ahead["box_2d"] == pytest.approx(expected, abs=1e-4)
    assert behind["box_2d"] == [-1.0] * 4


def test_tilted_camera_keeps_the_centre(tmp_path: Path) -> None:
    c, s = math.cos(0.5), math.sin(0.5)
    pitched = [1, 0, 0, 0, 0, c, -s, 0, 0, s, c, 0, 0, 0, 0, 1]
    card = export(
        store_of([label_row("0000", 0, "p", 0.9, **box(1.0, 10.0))], pitched), "s1", tmp_path
    )
    x, y, z, *_ = geometric(parse(tmp_path / "label_02" / "0000.txt")[0])
    assert (x, y, z) == pytest.approx((1.0, c * 1.0 - s * 10.0, s * 1.0 + c * 10.0), abs=1e-4)
    assert "tilted" in card.text()


def test_exported_labels_score_one_against_themselves(tmp_path: Path) -> None:
    labels = [label_row("0000", n, f"p{n}", 0.5, **box(n, 10 + n, 0.4 * n)) for n in range(3)]
    export(store_of(labels), "s1", tmp_path)
    truths = []
    for n, row in enumerate(parse(tmp_path / "label_02" / "0000.txt")):
        names = ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad")
        pixels = dict(zip(NO_BOX, row["box_2d"], strict=True))
        place = dict(zip(names, geometric(row), strict=True))
        truths.append(truth_row("0000", row["frame"], f"o{n}", **place, **pixels))
    store = make_store(
        f"export{next(_names)}",
        sequences=[sequence_row("0000")],
        frames=[frame_row("0000", n) for n in range(3)],
        ground_truth=truths,
        labels=labels,
    )
    scores = [s for s in evaluate(store, "s1").scores if s.subset == "all"]
    assert scores
    assert all(score.value == 1.0 for score in scores)


def test_undecided_labels_are_regions_of_no_track(tmp_path: Path) -> None:
    labels = [
        label_row("0000", 0, "p", 0.9, track_id="t", **box(0, 10)),
        label_row("0000", 0, "i", 0.5, state="ignore", track_id="t", **box(0, 10)),
        label_row(
            "0000", 0, "behind", 0.4, state="ignore", **(box(0, 10) | NO_BOX | {"z_m": -9.0})
        ),
    ]
    card = export(store_of(labels), "s1", tmp_path / "keep")
    _, ignored = (tmp_path / "keep/label_02/0000.txt").read_text().splitlines()
    assert ignored == (
        "0 -1 DontCare -1 -1 -10 530.000000 180.000000 670.000000 320.000000 "
        "-1 -1 -1 -1000 -1000 -1000 -10 -1"
    )
    assert (card.labels, card.ignored) == (1, 1)
    card = export(store_of(labels), "s1", tmp_path / "drop", ExportOptions(ignore="drop"))
    assert [row["type"] for row in parse(tmp_path / "drop/label_02/0000.txt")] == ["Car"]
    assert card.ignored == 0


def test_a_condition_leaves_tracks_their_labels(tmp_path: Path) -> None:
    labels = [
        label_row("0000", n, f"p{n}", 0.5 + n / 10, track_id="t", **box(0, 10)) for n in range(3)
    ]
    export(store_of(labels), "s1", tmp_path, ExportOptions(where="score > 0.55"))
    rows = parse(tmp_path / "label_02" / "0000.txt")
    assert [(row["frame"], row["track"]) for row in rows] == [(1, 0), (2, 0)]


def test_folder_that_is_not_empty(tmp_path: Path) -> None:
    store = store_of([label_row("0000", 0, "p", 0.9, **box(0, 10))])
    export(store, "s1", tmp_path)
    stale = tmp_path / "label_02" / "9999.txt"
    stale.write_text("old")
    with pytest.raises(TcrdataError, match="not empty"):
        export(store, "s1", tmp_path)
    export(store, "s1", tmp_path, ExportOptions(overwrite=True))
    assert stale.read_text() == "old"  # another sequence's: it may be ground truth
    (tmp_path / "file").write_text("")
    with pytest.raises(TcrdataError, match="cannot be made a folder"):
        export(store, "s1", tmp_path / "file")


def test_nothing_to_export(tmp_path: Path) -> None:
    store = store_of([])
    with pytest.raises(MissingEvidenceError, match=r"no positive labels.*tcrdata funnel"):
        export(store, "s1", tmp_path / "out")
    with pytest.raises(MissingEvidenceError, match="no selection 's2'"):
        export(store, "s2", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    with pytest.raises(TcrdataError, match="no type 'Dog'"):
        export(store, "s1", tmp_path / "out", ExportOptions(category="Dog"))
