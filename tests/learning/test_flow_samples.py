"""What a flow network learns from: which pairs, and what of them a student sees."""

from __future__ import annotations

from collections.abc import Iterator

import duckdb
import numpy as np
import pytest

from tcrdata.errors import FrameError, SettingsError
from tcrdata.learning.flow_runs import plan_finetuning
from tcrdata.learning.flow_samples import (
    GeneratedSamples,
    PairSettings,
    StoredPairs,
    TaughtSamples,
)
from tcrdata.learning.textured_planes import PlaneSettings
from tcrdata.networks.flow_losses import FlowLossSettings
from tcrdata.resources import resource_folder


@pytest.fixture
def shell() -> Iterator[duckdb.DuckDBPyConnection]:
    with duckdb.connect() as connection:
        path = resource_folder("schemas") / "frames.sql"
        connection.execute(path.read_text(encoding="utf-8"))
        yield connection


def add_drive(connection: duckdb.DuckDBPyConnection, name: str, images: str) -> None:
    """A frame a letter: i with an image, . without, x unreadable."""
    described = {
        row[0]: row[1] for row in connection.execute("describe frames").fetchall() if row[2] == "NO"
    }
    for frame, letter in enumerate(images):
        row = {column: "" if kind == "VARCHAR" else None for column, kind in described.items()}
        row |= {"dataset": "kitti", "sequence": name, "frame": frame, "round": 1}
        row |= {"has_image": letter == "i", "status": "error" if letter == "x" else "ok"}
        row = {
            column: ([0.0] if "[" in described.get(column, "") else 0) if value is None else value
            for column, value in row.items()
        }
        places = ", ".join("?" for _ in row)
        names = ", ".join(row)
        connection.execute(f"insert into frames ({names}) values ({places})", list(row.values()))


def parts(
    connection: duckdb.DuckDBPyConnection, held_out: float = 0.2, max_step: int = 4
) -> list[tuple[object, ...]]:
    text = (resource_folder("queries") / "training" / "flow.sql").read_text(encoding="utf-8")
    *setters, select = connection.extract_statements(text)
    for setter in setters:
        connection.execute(setter)
    connection.execute("set variable held_out_share = ?", [held_out])
    connection.execute("set variable max_step = ?", [max_step])
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


class Teacher:
    """Says that all moves by (5, 0), and remembers what it saw."""

    method = "raft"

    def __init__(self) -> None:
        self.seen: tuple[np.ndarray, np.ndarray] | None = None

    def both_ways(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.seen = first, second
        flow = np.zeros((*first.shape[:2], 2), np.float32)
        flow[..., 0] = 5
        return flow, -flow


def pair_of(height: int = 90, width: int = 140) -> dict[str, object]:
    whole = np.random.default_rng(0).integers(0, 256, (height, width + 5, 3), dtype=np.uint8)
    return {"key": "a", "first": whole[:, 5:], "second": whole[:, :-5]}


def piece_of(sample: dict[str, np.ndarray]) -> np.ndarray:
    return sample["images"][:, :3, 8:-8, 8:-8]


OWN = PairSettings(height_px=64, width_px=72, margin_px=8, flip=False)
HIDING, SHOWING = FlowLossSettings(), FlowLossSettings(occlusion=0)


def test_only_the_student_is_hidden_from() -> None:
    teacher = Teacher()
    sample = TaughtSamples(OWN, teacher, HIDING)(pair_of(), np.random.default_rng(1))
    assert teacher.seen is not None
    assert teacher.seen[0].shape[0] > 64
    covered = (sample["input"].reshape(2, 3, 64, 72) != piece_of(sample)).any(axis=1)
    assert covered.any()
    assert not covered.all()
    assert (covered.reshape(2, -1).any(axis=1)).sum() == 1
    number = int(covered[1].any())
    # Hidden in its own image; in the other one where the flow ends in a box.
    np.testing.assert_array_equal(sample["hidden"][number, 0] > 0, covered[number])
    shift = 5 if number == 1 else -5
    other = sample["hidden"][1 - number, 0] > 0
    rows, columns = np.nonzero(other)
    assert len(rows)
    assert covered[number][rows, columns + shift].all()
    np.testing.assert_array_equal(sample["taught"][0, 0], 5)
    assert sample["trusted"][0, 0, :, :60].all()


def test_without_occlusion_the_student_sees_what_the_teacher_sees() -> None:
    sample = TaughtSamples(OWN, Teacher(), SHOWING)(pair_of(), np.random.default_rng(1))
    np.testing.assert_array_equal(sample["input"].reshape(2, 3, 64, 72), piece_of(sample))
    assert not sample["hidden"].any()


def test_the_losses_say_which_pixels_of_the_teacher_are_trusted() -> None:
    class Unsure(Teacher):
        def both_ways(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            flow, back = super().both_ways(first, second)
            return flow, back + np.float32(2)

    def share(**settings: float) -> float:
        own = FlowLossSettings(occlusion=0, **settings)
        sample = TaughtSamples(OWN, Unsure(), own)(pair_of(), np.random.default_rng(1))
        return float(sample["trusted"].mean())

    # |w + w''|^2 is 8, |w|^2 + |w''|^2 is 38.
    assert share() == 0
    assert share(cycle_slack_px=7) > 0.9
    assert share(cycle_share=0.25) > 0.9


def test_images_smaller_than_the_piece_are_continued_at_their_edges() -> None:
    sample = TaughtSamples(OWN, Teacher(), SHOWING)(pair_of(40, 50), np.random.default_rng(0))
    assert sample["images"].shape == (2, 4, 80, 88)
    np.testing.assert_array_equal(piece_of(sample)[0, :, 40:, 0].std(axis=1), 0)


def test_around_the_piece_is_what_the_image_has_there() -> None:
    teacher = Teacher()
    sample = TaughtSamples(OWN, teacher, SHOWING)(pair_of(), np.random.default_rng(1))
    assert teacher.seen is not None
    for image, seen in zip(sample["images"], teacher.seen, strict=True):
        colours = image[:3, image[3].any(axis=1)][:, :, image[3].any(axis=0)]
        np.testing.assert_allclose(colours, np.moveaxis(seen, 2, 0) / 255, atol=1e-6)
        assert not image[:3, image[3] == 0].any()


def test_a_piece_too_small_is_refused() -> None:
    with pytest.raises(SettingsError, match="64 px a side"):
        PairSettings(height_px=32)


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
