"""Frames of a query: in one order whatever loads them, and from any sample on."""

from __future__ import annotations

import pickle
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learnt_worlds import SELECTION, learnt_world, select_by_hand
from torch.utils.data import DataLoader

import tcrdata
from tcrdata.errors import MissingEvidenceError, QueryError, SettingsError, StoreError
from tcrdata.learning.frames import freeze_training_tables, open_frames
from tcrdata.learning.stream import FrameStream
from tcrdata.store import Store, Unit
from tcrdata.store.arrays import encode_flow

KEYS = "-- reads: points\nselect dataset, sequence, frame from frames order by frame"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return learnt_world(tmp_path_factory.mktemp("world"))


def frames_in(samples: Any) -> list[int]:
    return [sample["frame"] for sample in samples]


def test_a_sample_is_a_row_with_what_the_query_reads(store: Store) -> None:
    stream = tcrdata.torch_dataset(store.url, "segmenter", parameters={"selection_id": SELECTION})
    assert len(stream) == 5
    sample = next(iter(stream))
    assert sample["image"].shape == (48, 160, 3)
    count = len(sample["points"])
    assert sample["points"].shape == (count, 3)
    for cue in ("ground", "height_m", "votes_free", "votes_static", "reflectance"):
        assert len(sample[cue]) == count
    assert {label["positive"] for label in sample["labels"]} == {True, False}
    assert sample["camera"].frame == sample["frame"]
    assert sample["position"] == 0


def test_an_epoch_holds_every_frame_once_in_an_order_of_its_own(store: Store) -> None:
    stream = FrameStream(open_frames(store, KEYS), seed=3, epochs=3)
    listed = frames_in(stream)
    assert len(listed) == len(stream) == 15
    epochs = [listed[i : i + 5] for i in (0, 5, 10)]
    assert all(sorted(epoch) == list(range(5)) for epoch in epochs)
    assert len({tuple(epoch) for epoch in epochs}) > 1
    assert listed == frames_in(FrameStream(open_frames(store, KEYS), seed=3, epochs=3))
    assert listed != frames_in(FrameStream(open_frames(store, KEYS), seed=4, epochs=3))


def test_it_resumes_in_the_middle_of_an_epoch_at_the_very_sample(store: Store) -> None:
    frames = open_frames(store, KEYS)
    whole = list(FrameStream(frames, seed=1, epochs=2))
    rest = list(FrameStream(frames, seed=1, epochs=2, start=whole[6]["position"] + 1))
    assert frames_in(rest) == frames_in(whole)[7:]


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_the_order_is_that_of_one_process_whatever_the_number_of_workers(
    store: Store, workers: int
) -> None:
    stream = FrameStream(open_frames(store, KEYS), seed=2, epochs=2)
    loader = DataLoader(
        stream,
        batch_size=None,
        num_workers=workers,
        multiprocessing_context="fork" if workers else None,
    )
    assert frames_in(loader) == frames_in(stream)


class ManyDrives:
    """Six drives of four frames each, one after the other."""

    def __len__(self) -> int:
        return 24

    def drives(self) -> np.ndarray:
        return np.arange(24) // 4

    def __getitem__(self, number: int) -> dict[str, Any]:
        return {"frame": number}


def test_of_many_drives_a_few_are_shuffled_at_a_time() -> None:
    def order(**settings: Any) -> list[int]:
        return frames_in(FrameStream(ManyDrives(), drives_together=2, **settings))

    listed = order(seed=1, epochs=2)
    parts = [listed[i : i + 8] for i in range(0, 48, 8)]
    drives = [tuple(sorted({number // 4 for number in part})) for part in parts]
    assert all(
        len(pair) == 2 and len(set(part)) == 8 for pair, part in zip(drives, parts, strict=True)
    )
    assert sorted(listed[:24]) == sorted(listed[24:]) == list(range(24))
    assert drives[:3] != drives[3:], "the drives are shuffled, too"
    assert any(part != sorted(part) for part in parts)
    assert order(seed=1, epochs=2, start=29) == listed[29:]
    assert order(seed=2, epochs=2) != listed


@pytest.mark.parametrize(
    "wrong", [{"start": -1}, {"rank": 2, "world_size": 2}, {"drives_together": 0}]
)
def test_a_place_that_is_none_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(SettingsError, match="positions and ranks count from 0"):
        FrameStream(ManyDrives(), **wrong)


def test_ranks_share_the_frames_without_overlap(store: Store) -> None:
    frames = open_frames(store, KEYS)
    whole = list(FrameStream(frames, seed=2, epochs=2))
    halves = [list(FrameStream(frames, seed=2, epochs=2, rank=r, world_size=2)) for r in (0, 1)]
    assert [len(FrameStream(frames, epochs=2, rank=r, world_size=2)) for r in (0, 1)] == [5, 5]
    positions = sorted(sample["position"] for half in halves for sample in half)
    assert positions == [sample["position"] for sample in whole]
    assert frames_in(halves[1]) == frames_in(whole)[1::2]


def test_random_numbers_belong_to_the_position_not_to_the_process(store: Store) -> None:
    frames = open_frames(store, KEYS)
    stream = FrameStream(frames, seed=2, transform=draw)
    numbers = [sample["number"] for sample in stream]
    assert len(set(numbers)) == 5
    late = FrameStream(frames, seed=2, start=3, transform=draw)
    assert [sample["number"] for sample in late] == numbers[3:]


def draw(sample: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    return {"number": float(rng.random())}


def test_an_endless_stream_goes_on(store: Store) -> None:
    stream = FrameStream(open_frames(store, KEYS), epochs=None)
    assert len(list(islice(stream, 12))) == 12
    with pytest.raises(TypeError, match="no length"):
        len(stream)


def test_frames_travel_to_other_processes_as_names_alone(store: Store) -> None:
    frames = open_frames(store, KEYS)
    frames[0]
    again = pickle.loads(pickle.dumps(frames))
    assert len(pickle.dumps(frames)) < 1000
    assert np.array_equal(again[2]["points"], frames[2]["points"])


def test_what_lands_later_is_not_in_the_snapshot(tmp_path: Path) -> None:
    store = learnt_world(tmp_path)
    snapshot = freeze_training_tables(store)
    before = open_frames(store, "detector", snapshot=snapshot)[0]["labels"]
    select_by_hand(store, "s2", [])
    rows = store.read("labels", selection_id=SELECTION).to_pylist()
    select_by_hand(store, "s3", rows)
    assert open_frames(store, "detector", snapshot=snapshot)[0]["labels"] == before
    assert len(open_frames(store, "detector")[0]["labels"]) == 2 * len(before)


def test_ground_truth_cannot_be_read(store: Store) -> None:
    assert store.read("ground_truth").num_rows > 0
    with pytest.raises(QueryError, match="ground_truth"):
        open_frames(store, "select dataset, sequence, frame from ground_truth")


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("select dataset, sequence from frames", "lacks the column frame"),
        ("select nonsense from frames", "nonsense"),
        ("select dataset sequence frame from", "syntax error"),
    ],
)
def test_a_wrong_query_is_named(store: Store, query: str, message: str) -> None:
    with pytest.raises(QueryError, match=message):
        tcrdata.torch_dataset(store.url, query)


def test_an_unknown_query_says_which_there_are(store: Store) -> None:
    with pytest.raises(SettingsError, match="detector, flow, segmenter"):
        tcrdata.torch_dataset(store.url, "detectors")


def test_an_unknown_parameter_says_which_there_are(store: Store) -> None:
    with pytest.raises(SettingsError, match=r"no parameter 'nearness'.*near_m"):
        open_frames(store, "detector", parameters={"nearness": 3})


def test_a_parameter_keeps_its_type(store: Store) -> None:
    with pytest.raises(SettingsError, match="near_m must be a decimal"):
        open_frames(store, "detector", parameters={"near_m": "wide"})


def test_no_frame_is_an_error_that_says_so(store: Store) -> None:
    with pytest.raises(MissingEvidenceError, match="gives no frame"):
        open_frames(store, "detector", parameters={"selection_id": "nobody"})


def test_an_unknown_snapshot_is_named(store: Store) -> None:
    with pytest.raises(StoreError, match="no snapshot 'monday'"):
        tcrdata.torch_dataset(store.url, KEYS, snapshot="monday")


def test_a_cue_nobody_measured_is_named(store: Store) -> None:
    frames = open_frames(store, KEYS.replace("points", "motion_3d_m"))
    with pytest.raises(MissingEvidenceError, match=r"frame 0: no cue 'motion_3d_m'"):
        frames[0]


def test_flow_comes_with_a_frame_where_the_query_names_it(tmp_path: Path) -> None:
    store = learnt_world(tmp_path, frames=2, images=False)
    (sequence,) = store.read("sequences")["sequence"].to_pylist()
    rng = np.random.default_rng(0)
    fields = [rng.uniform(-9, 9, (6, 8, 2)).astype(np.float32) for _ in range(2)]
    codecs, data = zip(*map(encode_flow, fields), strict=True)
    columns = {
        "frame": [0, 1], "frame_to": [1, 0], "direction": ["forward", "backward"],
        "method": ["dis"] * 2, "width_px": [8] * 2, "height_px": [6] * 2,
        "codec": list(codecs), "data": list(data),
    }  # fmt: skip
    with store.writer(Unit("flow", "kitti", sequence, 1), settings_hash="0", inputs={}) as writer:
        writer.append("flows", columns)
    query = "-- reads: {}\nselect dataset, sequence, frame from flows where direction = '{}'"
    for name, direction, field in zip(
        ("flow", "flow_backward"), ("forward", "backward"), fields, strict=True
    ):
        (sample,) = FrameStream(open_frames(store, query.format(name, direction)))
        assert np.abs(sample[name] - field).max() <= 1 / 128
    with pytest.raises(MissingEvidenceError, match=r"frame 1: no direction 'forward' in flows"):
        open_frames(store, query.format("flow", "backward"))[0]
