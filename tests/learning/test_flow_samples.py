"""What a flow network learns from: which pairs, and what of them a student sees."""

from __future__ import annotations

from collections.abc import Iterator

import duckdb
import numpy as np
import pytest

from tcrdata.errors import FrameError
from tcrdata.learning.flow_recipes import plan_finetuning
from tcrdata.learning.flow_samples import (
    GeneratedSamples,
    StoredPairs,
)
from tcrdata.learning.textured_planes import PlaneSettings
from tcrdata.resources import resource_folder


@pytest.fixture
def shell() -> Iterator[duckdb.DuckDBPyConnection]:
    with duckdb.connect() as connection:
        path = resource_folder("schemas") / "frames.sql"
        connection.execute(path.read_text(encoding="utf-8"))
        yield connection


def add_drive(connection: duckdb.DuckDBPyConnection, name: str, images: str) -> None:
    """A frame a letter: i with an image, I with a larger one, . without, x unreadable."""
    described = {
        row[0]: row[1] for row in connection.execute("describe frames").fetchall() if row[2] == "NO"
    }
    for frame, letter in enumerate(images):
        row = {column: "" if kind == "VARCHAR" else None for column, kind in described.items()}
        row |= {"dataset": "kitti", "sequence": name, "frame": frame, "round": 1}
        row |= {"width_px": {"i": 4, "I": 5}.get(letter), "height_px": 4}
        row |= {"has_image": letter in "iI", "status": "error" if letter == "x" else "ok"}
        row = {
            column: ([0.0] if "[" in described.get(column, "") else 0) if value is None else value
            for column, value in row.items()
        }
        places = ", ".join("?" for _ in row)
        names = ", ".join(row)
        connection.execute(f"insert into frames ({names}) values ({places})", list(row.values()))


def parts(
    connection: duckdb.DuckDBPyConnection, held_out: float = 0.2, **limits: int
) -> list[tuple[object, ...]]:
    text = (resource_folder("queries") / "training" / "flow.sql").read_text(encoding="utf-8")
    *setters, select = connection.extract_statements(text)
    for setter in setters:
        connection.execute(setter)
    connection.execute("set variable held_out_share = ?", [held_out])
    for name, value in {"max_step": 4, **limits}.items():
        connection.execute(f"set variable {name} = ?", [value])
    rows = connection.execute(select.query).fetchall()
    return [row[1:6] for row in rows]


def test_the_last_pairs_of_a_drive_are_held_out_and_share_no_frame_with_the_others(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    add_drive(shell, "a", "iiiiii")
    assert parts(shell, 0.4) == [
        ("a", 0, 1, "learnt", 2),
        ("a", 1, 2, "learnt", 1),
        ("a", 2, 3, None, 0),
        ("a", 3, 4, "held out", 1),
        ("a", 4, 5, "held out", 1),
        ("a", 5, None, None, 0),
    ]


def test_steps_are_as_long_as_asked_for_and_never_over_what_is_missing(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    add_drive(shell, "a", "iiiii.iiiiii")
    steps = [row[-1] for row in parts(shell, 0.1, max_step=3)]
    assert steps == [3, 3, 2, 1, 0, 3, 2, 1, 0, 1, 0]
    assert [row[-1] for row in parts(shell, 0.1, max_step=1)] == [min(1, n) for n in steps]


def test_pairs_need_two_images_of_frames_that_follow_one_another(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    add_drive(shell, "a", "ii.iixii")
    add_drive(shell, "b", "ii")
    assert parts(shell) == [
        ("a", 0, 1, "learnt", 1),
        ("a", 1, None, None, 0),
        ("a", 3, 4, "learnt", 1),
        ("a", 4, 6, None, 0),
        ("a", 6, 7, "held out", 1),
        ("a", 7, None, None, 0),
        ("b", 0, 1, "held out", 1),
        ("b", 1, None, None, 0),
    ]


def begun(rows: list[tuple[object, ...]]) -> dict[object, list[tuple[object, ...]]]:
    """Drive and frame of those that begin a pair, by part."""
    found: dict[object, list[tuple[object, ...]]] = {}
    for drive, frame, _, part, steps in rows:
        if steps:
            found.setdefault(part, []).append((drive, frame))
    return found


def test_of_many_pairs_so_many_count_as_asked_for_evenly_over_all(
    shell: duckdb.DuckDBPyConnection,
) -> None:
    for name in "abc":
        add_drive(shell, name, "i" * 13)
    rows = parts(shell, 0.25, max_step=1, most_learnt=6, most_held_out=4)
    assert begun(rows) == {
        "learnt": [("a", 3), ("a", 7), ("b", 3), ("b", 7), ("c", 3), ("c", 7)],
        "held out": [("a", 11), ("b", 10), ("c", 9), ("c", 11)],
    }
    assert parts(shell, 0.25, most_learnt=24, most_held_out=9) == parts(shell, 0.25)


def test_frames_of_no_chosen_pair_are_left_out(shell: duckdb.DuckDBPyConnection) -> None:
    add_drive(shell, "a", "i" * 13)
    rows = parts(shell, 0.25, max_step=2, most_learnt=2, most_held_out=1)
    assert [row[1:] for row in rows] == [
        (3, 4, "learnt", 2),
        (4, 5, "learnt", 0),
        (5, 6, "learnt", 0),
        (7, 8, "learnt", 1),
        (8, 9, None, 0),
        (11, 12, "held out", 1),
        (12, None, None, 0),
    ]


@pytest.mark.parametrize(
    ("limits", "left"),
    [({"max_step": 0}, {"held out"}), ({"max_step": -2}, {"held out"}),
     ({"most_learnt": 0}, {"held out"}), ({"most_held_out": -1}, {"learnt"})],
)  # fmt: skip
def test_a_limit_of_none_leaves_none(
    shell: duckdb.DuckDBPyConnection, limits: dict[str, int], left: set[str]
) -> None:
    add_drive(shell, "a", "i" * 8)
    assert begun(parts(shell, **limits)).keys() == left


def test_images_of_two_sizes_are_no_pair(shell: duckdb.DuckDBPyConnection) -> None:
    add_drive(shell, "a", "iiiIIiii")
    assert begun(parts(shell, 0.2, max_step=3)) == {
        "learnt": [("a", 0), ("a", 1), ("a", 3)],
        "held out": [("a", 6)],
    }


class Rows:
    """Frames of one drive as the query has them: each with its part and how many pairs it begins.

    The image of each is a pixel wider than the one before, if told so.
    """

    def __init__(self, parts: list[tuple[str | None, int]], *, wider: bool = False) -> None:
        self.rows = [
            {"dataset": "kitti", "sequence": "a", "frame": 2 * n, "frame_to": 2 * n + 2,
             "part": part, "steps": steps, "image": np.full((4, 5 + n * wider, 3), n, np.uint8)}
            for n, (part, steps) in enumerate(parts)
        ]  # fmt: skip

    def __getitem__(self, number: int) -> dict[str, object]:
        return self.rows[number]

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, name: str) -> list[object]:
        return [row[name] for row in self.rows]

    def drives(self) -> np.ndarray:
        return np.arange(len(self.rows)) // 3


def test_a_frame_begins_a_pair_with_each_of_the_frames_in_its_reach() -> None:
    rows = Rows([("learnt", 2), ("learnt", 1), (None, 0), ("held out", 1), (None, 0)])
    pairs = StoredPairs(rows, "learnt")
    ends = [(pair["frame"], pair["frame_to"]) for pair in map(pairs.__getitem__, range(len(pairs)))]
    assert ends == [(0, 2), (0, 4), (2, 4)]
    assert [int(pairs[n]["second"].mean()) for n in range(3)] == [1, 2, 2]
    assert pairs.column("frame") == [0, 0, 2]
    held_out = StoredPairs(rows, "held out")
    assert [held_out[n]["frame"] for n in range(len(held_out))] == [6]
    assert held_out.drives().tolist() == [1]
    assert len(StoredPairs(Rows([]), "learnt")) == 0


def test_a_pair_of_two_sizes_is_refused_by_name() -> None:
    pairs = StoredPairs(Rows([("learnt", 1), (None, 0)], wider=True), "learnt")
    assert len(pairs) == 1
    with pytest.raises(FrameError, match="kitti/a frames 0, 2: images of two sizes"):
        pairs[0]


def test_a_generated_pair_comes_with_its_mirror_images() -> None:
    draw = GeneratedSamples(PlaneSettings(height_px=64, width_px=80))
    sample = draw({"key": "generated"}, np.random.default_rng(4))
    images, flow = sample["input"], sample["flow"]
    assert images.shape == (4, 6, 64, 80)
    assert sample["known"].shape == (4, 1, 64, 80)
    np.testing.assert_array_equal(images[1], images[0, :, :, ::-1])
    np.testing.assert_array_equal(images[2], images[0, :, ::-1])
    np.testing.assert_array_equal(flow[1, 0], -flow[0, 0, :, ::-1])
    np.testing.assert_array_equal(flow[1, 1], flow[0, 1, :, ::-1])
    np.testing.assert_array_equal(flow[3], -flow[0, :, ::-1, ::-1])


def test_a_loss_that_is_named_has_help_only_where_that_is_asked_for() -> None:
    teacher = {"model_id": "t", "settings": {"network": {"size": "small"}}}
    named = ("photometric",)
    assert plan_finetuning(teacher, None, {}).losses.unseen > 0
    alone = plan_finetuning(teacher, named, {}).losses
    assert (alone.unseen, alone.teacher, alone.occlusion) == (0, 0, 0)
    asked = {"losses.unseen": "0.01", "losses.teacher": "1"}
    helped = plan_finetuning(teacher, named, asked).losses
    assert (helped.unseen, helped.teacher) == (0.01, 0)
