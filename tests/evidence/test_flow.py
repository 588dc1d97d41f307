from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plane_world import ArrayDataset, MemoryTables, cue_input, frame, without_image

from tcrdata.errors import EvidenceError, FrameError
from tcrdata.evidence import flow, flow_estimators
from tcrdata.evidence.flow_cycle import PAPER_BIT, RELEASE_BIT
from tcrdata.evidence.stored_flow import image_pairs, read_flow
from tcrdata.types import Frame


def textured(shift: tuple[int, int] = (0, 0)) -> np.ndarray:
    from scipy import ndimage

    noise = np.random.default_rng(0).uniform(0, 255, (160, 200))
    smooth = ndimage.gaussian_filter(noise, 2.0)
    smooth = (smooth - smooth.min()) / np.ptp(smooth) * 255
    moved = np.roll(smooth, shift, axis=(1, 0))[20:140, 20:180]
    return np.repeat(moved.astype(np.uint8)[..., None], 3, axis=2)


@pytest.fixture(scope="module")
def measured() -> MemoryTables:
    dataset = ArrayDataset({}, {0: textured(), 1: textured((4, -3)), 2: textured((8, -6))})
    tables = MemoryTables()
    frames = [frame(n) for n in range(3)]
    tables.add(flow.run(cue_input(dataset, tables, flow.Settings(), frames)))
    return tables


def test_both_directions_of_each_pair_have_a_row(measured: MemoryTables) -> None:
    keys = [(row["frame"], row["frame_to"], row["direction"]) for row in measured.rows["flows"]]
    assert keys == [
        (0, 1, "forward"),
        (1, 0, "backward"),
        (1, 2, "forward"),
        (2, 1, "backward"),
    ]


def test_a_known_shift_is_found(measured: MemoryTables) -> None:
    forward = read_flow(measured, frame(0), frame(1))
    backward = read_flow(measured, frame(1), frame(0))
    assert forward is not None
    assert backward is not None
    np.testing.assert_allclose(np.median(forward.decode(), axis=(0, 1)), (4, -3), atol=0.1)
    np.testing.assert_allclose(np.median(backward.decode(), axis=(0, 1)), (-4, 3), atol=0.1)


def test_shares_are_those_of_the_stored_planes(measured: MemoryTables) -> None:
    row = measured.rows["flows"][0]
    stored = read_flow(measured, frame(0), frame(1))
    assert stored is not None
    assert row["cycle_share_paper"] == stored.passes("paper").mean()
    assert row["cycle_share_release"] == stored.passes("release").mean()
    assert 0.8 < row["cycle_share_release"] <= row["cycle_share_paper"] <= 1
    assert stored.passes("none").all()
    assert row["cycle_error_median_px"] < 0.1
    assert row["magnitude_median_px"] == pytest.approx(5, abs=0.1)
    assert PAPER_BIT & RELEASE_BIT == 0


def test_the_same_images_give_the_same_bytes(measured: MemoryTables) -> None:
    dataset = ArrayDataset({}, {0: textured(), 1: textured((4, -3))})
    again = MemoryTables()
    settings = flow.Settings(pairs_per_task=1)
    again.add(flow.run(cue_input(dataset, again, settings, [frame(0), frame(1)])))
    for name in ("data", "consistent", "cycle_share_paper"):
        assert again.rows["flows"][0][name] == measured.rows["flows"][0][name]


def test_frames_without_images_have_no_rows() -> None:
    frames = [frame(0), without_image(1), frame(2)]
    assert image_pairs(frames) == []
    tables = MemoryTables()
    assert not list(flow.run(cue_input(ArrayDataset({}), tables, flow.Settings(), frames)))


def test_images_of_two_sizes_are_one_clear_error_and_the_rest_goes_on() -> None:
    images = {0: textured()[:-10], 1: textured(), 2: textured((4, -3))}
    tables = MemoryTables()
    frames = [frame(n) for n in range(3)]
    tables.add(flow.run(cue_input(ArrayDataset({}, images), tables, flow.Settings(), frames)))
    (error,) = tables.rows["errors"]
    assert error["frame"] == 0
    assert "160x110" in error["error"]
    assert "frame 1 has 160x120" in error["error"]
    assert [row["frame"] for row in tables.rows["flows"]] == [1, 2]


def test_an_image_that_cannot_be_read_is_one_error_of_its_own_frame() -> None:
    class Damaged(ArrayDataset):
        def read_image(self, frame: Frame) -> np.ndarray:
            if frame.frame == 1:
                raise FrameError("frame 1: image is cut short")
            return self.images[frame.frame]

    dataset = Damaged({}, {n: textured() for n in (0, 2, 3)})
    tables = MemoryTables()
    frames = [frame(n) for n in range(4)]
    tables.add(flow.run(cue_input(dataset, tables, flow.Settings(), frames)))
    assert tables.rows["errors"] == [{"frame": 1, "error": "frame 1: image is cut short"}]
    assert [row["frame"] for row in tables.rows["flows"]] == [2, 3]


@pytest.mark.parametrize("shape", [(3, 5), (8, 100), (15, 40), (20, 7)])
def test_an_image_smaller_than_dis_takes_has_flow(shape: tuple[int, int]) -> None:
    height, width = shape
    first, second = (textured(shift)[:height, :width] for shift in ((0, 0), (1, 0)))
    for found in flow_estimators.Dis().both_ways(first, second):
        assert found.shape == (*shape, 2)
        assert np.isfinite(found).all()


def test_a_network_that_is_not_named_is_asked_for_without_labels() -> None:
    tables = MemoryTables()
    settings = flow.Settings(method="raft")
    with pytest.raises(EvidenceError, match=r"run `tcrdata train flow`, or name a model"):
        list(flow.run(cue_input(ArrayDataset({}), tables, settings, [frame(0), frame(1)])))


def test_an_unmeasured_pair_is_none(measured: MemoryTables) -> None:
    assert read_flow(measured, frame(0), frame(2)) is None
    assert read_flow(measured, frame(2), frame(3)) is None


@pytest.mark.real
def test_dis_is_near_the_truth_on_real_pairs(real_data: Path) -> None:
    import cv2

    folder = real_data / "flow" / "flying_chairs"
    for number in (1, 2, 3):
        first, second = (
            cv2.imread(str(folder / f"{number:07d}-img{i}.ppm"), cv2.IMREAD_GRAYSCALE)
            for i in (0, 1)
        )
        truth = cv2.readOpticalFlow(str(folder / f"{number:07d}-gt.flo"))
        error = np.linalg.norm(flow_estimators.dis_flow(first, second) - truth, axis=2)
        assert np.median(error) < 0.3
