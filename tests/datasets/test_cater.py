"""Generated clips: what moves, what is covered, from six sides; and the same clips as files."""

from __future__ import annotations

import json
import pickle
import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_runs import done
from PIL import Image

from tcrdata.datasets.cater import Cater, generate, open_dataset
from tcrdata.datasets.cater_scenes import build_clip
from tcrdata.datasets.footprints import footprints, gap_m
from tcrdata.errors import DatasetError, FrameError
from tcrdata.types import SeveralCameras

CLIP = "clip_0000_camera_0"
SMALL = "clips=1,seed=3,frames=3,cameras=2"


@pytest.fixture(scope="module")
def truth() -> dict[str, list[dict[str, Any]]]:
    rows = defaultdict(list)
    for row in open_dataset("seed=3,cameras=1").ground_truth(CLIP):
        rows[row["object_id"]].append(row)
    return rows


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("clips")
    generation = generate(SMALL, str(root))
    assert sum(1 for _ in generation.work) == generation.steps == 2 * 3
    return root


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    shutil.copytree(folder, tmp_path / "clips")
    return tmp_path / "clips"


def test_the_root_is_the_spec_written_out() -> None:
    expected = "clips=2,seed=3,frames=50,cameras=6,hard=false,noise_m=0.05,missing=-1.0"
    cater = open_dataset("clips=2,seed=3")
    assert cater.root == generate("clips=2,seed=3", "").root == expected
    assert generate("2", "").root == open_dataset("clips=2").root
    assert len(cater.sequences()) == 12
    assert cater.sequences()[7] == "clip_0001_camera_1"
    assert pickle.loads(pickle.dumps(cater)) == cater


@pytest.mark.parametrize("root", ["nowhere", "clips=x", "cameras=7", "colour=3"])
def test_a_wrong_root_is_named(root: str) -> None:
    with pytest.raises(DatasetError, match=root.partition("=")[0]):
        open_dataset(root)


@pytest.mark.parametrize(("hard", "fewest", "most"), [(False, 5, 10), (True, 16, 22)])
def test_objects_keep_apart_all_the_time(hard: bool, fewest: int, most: int) -> None:
    scene = build_clip(2, 0, 50, hard)
    assert fewest <= len(scene.objects) <= most
    assert scene.objects[0].object_id == "00_gold_sphere"
    times = [frame / 24 for frame in range(50)]
    prints = [footprints(thing.motion, times) for thing in scene.objects]  # type: ignore[arg-type]
    held = {frozenset((entry.inner, entry.outer)) for entry in scene.containments}
    nearest = [
        gap_m(prints[a], prints[b])
        for a in range(len(prints))
        for b in range(a)
        if frozenset((a, b)) not in held
    ]
    # Between the frames that were looked at, two things may come a little nearer.
    assert min(nearest) > (-0.03 if hard else 0.02)
    assert (min(nearest) < 0.05) == hard


def test_about_a_third_moves_and_some_are_covered_and_carried() -> None:
    moving, covered, carried = [], 0, 0
    for seed in range(8):
        scene = build_clip(seed, 0, 50, hard=False)
        for frame in range(50):
            for number, thing in enumerate(scene.objects):
                moves = thing.speed(frame / 24) > 1e-3
                outer = scene.container(number, frame / 24)
                moving.append(moves)
                covered += outer is not None
                carried += outer is not None and moves
                if outer is not None:
                    pose, cone = thing.motion.pose(frame / 24), outer.motion.pose(frame / 24)
                    np.testing.assert_allclose(pose[:2, 3], cone[:2, 3], atol=1e-9)
    assert 0.2 < np.mean(moving) < 0.45
    assert covered > 20
    assert carried > 5


def test_what_is_covered_shows_nothing(truth: dict[str, list[dict[str, Any]]]) -> None:
    covered = [row for rows in truth.values() for row in rows if row["contained_in"]]
    assert covered
    assert {row["visible_px"] for row in covered} == {0}
    assert {row["occluded"] for row in covered} == {1.0}
    assert {row["contained_in"].rpartition("_")[2] for row in covered} == {"cone"}


def test_truth_is_complete_over_time(truth: dict[str, list[dict[str, Any]]]) -> None:
    assert all([row["frame"] for row in rows] == list(range(50)) for rows in truth.values())
    tilted = [r for rows in truth.values() for r in rows if abs(r["level_R_object"][4]) < 0.99]
    assert {row["category"] for row in tilted} <= {"box", "cylinder"}
    assert all(row["yaw_observable"] for row in tilted)


def test_cameras_see_one_scene() -> None:
    cater = open_dataset("seed=3,noise_m=0")
    assert isinstance(cater, SeveralCameras)
    frame = cater.frames(CLIP)[10]
    others = cater.simultaneous(frame)
    assert [other.sequence[-1] for other, _ in others] == ["1", "2", "3", "4", "5"]
    own = {row["object_id"]: row for row in cater.ground_truth(CLIP) if row["frame"] == 10}
    other, level_T_other = others[2]
    moved = cater.read_points(other).xyz @ level_T_other[:3, :3].T + level_T_other[:3, 3]
    table_m = np.median(cater.read_points(frame).xyz[:, 1])
    assert np.quantile(moved[:, 1], 0.999) == pytest.approx(table_m, abs=1e-3)
    for row in cater.ground_truth(other.sequence):
        if row["frame"] == 10:
            place = level_T_other @ [row["x_m"], row["y_m"], row["z_m"], 1.0]
            mine = own[row["object_id"]]
            np.testing.assert_allclose(place[:3], [mine[n] for n in ("x_m", "y_m", "z_m")])


def test_hard_clips_miss_a_tenth_of_the_depth() -> None:
    frame = open_dataset("hard=true").frames(CLIP)[0]
    whole = len(open_dataset("hard=true,missing=0").read_points(frame))
    assert len(open_dataset("hard=true").read_points(frame)) / whole == pytest.approx(0.9, abs=0.01)
    assert len(open_dataset("missing=0.5").read_points(frame)) < 0.6 * whole


def test_written_clips_read_as_they_were_generated(folder: Path) -> None:
    disk, made = open_dataset(str(folder)), open_dataset(SMALL)
    assert disk.sequences() == made.sequences()
    for sequence in disk.sequences():
        for mine, theirs in zip(disk.frames(sequence), made.frames(sequence), strict=True):
            assert mine.timestamp_ns == theirs.timestamp_ns
            np.testing.assert_allclose(mine.camera_T_level, theirs.camera_T_level, atol=1e-12)
            np.testing.assert_array_equal(disk.read_image(mine), made.read_image(theirs))
            a, b = disk.read_points(mine), made.read_points(theirs)
            np.testing.assert_array_equal(a.pixels, b.pixels)
            np.testing.assert_allclose(a.xyz, b.xyz, atol=5e-4)
        pairs = zip(disk.ground_truth(sequence), made.ground_truth(sequence), strict=True)
        for row, expected in pairs:
            # Files hold a pose a frame: speeds between them are those of straight lines.
            assert row.pop("speed_mps") == pytest.approx(expected.pop("speed_mps"), abs=0.5)
            for name, value in row.items():
                assert value == (expected[name] if value is None else pytest.approx(expected[name]))


def test_the_exact_flow_of_files_is_that_of_the_generator(copied: Path) -> None:
    made, disk = open_dataset(SMALL), open_dataset(str(copied))
    start, end = made.frames(CLIP)[1:3]
    flow, expected = disk.exact_flow(start, end), made.exact_flow(start, end)
    assert flow is not None
    assert expected is not None
    known = np.isfinite(flow).all(axis=2)
    np.testing.assert_allclose(flow[known], expected[known], atol=1e-3)
    np.testing.assert_allclose(expected[~known], 0, atol=1e-9)  # files have no table
    assert np.abs(flow[known]).max() > 0.1
    (copied / "clip_0000" / "truth.json").unlink()
    assert open_dataset(str(copied)).exact_flow(start, end) is None


def test_written_clips_are_left_alone_and_others_refused(folder: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")}
    assert sum(1 for _ in generate(SMALL, str(folder)).work) == 6
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")} == before
    with pytest.raises(DatasetError, match="another clip"):
        next(generate(SMALL.replace("seed=3", "seed=4"), str(folder)).work)


def test_a_folder_is_found_from_other_folders_too(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder.parent)
    assert open_dataset(folder.name).info(CLIP).root == str(folder)


def test_labels_touch_nothing_but_the_truth(copied: Path) -> None:
    cater = open_dataset(str(copied))
    before = (cater.info(CLIP), cater.frames(CLIP))
    (copied / "clip_0000" / "truth.json").unlink()
    assert (cater.info(CLIP), cater.frames(CLIP)) == before
    assert cater.ground_truth(CLIP) == []


def test_damaged_frames_are_errors_of_their_own(copied: Path) -> None:
    camera = copied / "clip_0000" / "camera_0"
    (camera / "depth" / "000000.png").unlink()
    (camera / "rgb" / "000001.png").write_bytes(b"no image")
    shutil.copy(camera / "rgb" / "000002.png", camera / "depth" / "000002.png")
    cater = open_dataset(str(copied))
    frames = cater.frames(CLIP)
    assert [frame.status for frame in frames] == ["error", "ok", "ok"]
    assert "no depth image 000000.png" in str(frames[0].error)
    assert "000001.png" in str(frames[1].image_error)
    with pytest.raises(FrameError, match="16 bits"):
        cater.read_points(frames[2])


def test_pixels_that_are_not_as_they_were_written_are_an_error(copied: Path) -> None:
    path = copied / "clip_0000" / "camera_0" / "depth" / "000001.png"
    data = bytearray(path.read_bytes())
    data[-20] ^= 1  # the checksum at the end of the pixels
    path.write_bytes(data)
    cater = open_dataset(str(copied))
    with pytest.raises(FrameError, match=r"000001\.png cannot be decoded: the chunk IDAT"):
        cater.read_points(cater.frames(CLIP)[1])


def test_which_image_is_cut_short_is_said(copied: Path) -> None:
    for kind, number in (("depth", 0), ("rgb", 1)):
        path = copied / "clip_0000" / "camera_0" / kind / f"{number:06d}.png"
        path.write_bytes(path.read_bytes()[:500])
    first, second, _ = open_dataset(str(copied)).frames(CLIP)
    assert str(first.error).startswith("depth image 000000.png is cut short")
    assert str(second.image_error).startswith("rgb image 000001.png is cut short")


def test_an_image_of_another_size_is_an_error(copied: Path) -> None:
    path = copied / "clip_0000" / "camera_0" / "depth" / "000001.png"
    Image.fromarray(np.ones((120, 160), np.uint16)).save(path)
    cater = open_dataset(str(copied))
    frame = cater.frames(CLIP)[1]
    assert (frame.status, frame.error) == (
        "error",
        "depth image 000001.png is 160x120, unlike its camera",
    )
    with pytest.raises(FrameError, match="160x120 pixels; its calibration says 320x240"):
        cater.read_points(frame)


def test_numbers_of_other_than_six_digits_are_read(copied: Path) -> None:
    cater = open_dataset(str(copied))
    before = cater.read_points(cater.frames(CLIP)[2]).xyz
    for path in (copied / "clip_0000" / "camera_0").glob("*/*.png"):
        path.rename(path.with_name(f"{int(path.stem):04d}.png"))
    frame = cater.frames(CLIP)[2]
    assert frame.image_path == "clip_0000/camera_0/rgb/0002.png"
    np.testing.assert_array_equal(cater.read_points(frame).xyz, before)


def test_a_clip_that_was_begun_goes_on_and_no_other_mixes_with_it(tmp_path: Path) -> None:
    tiny = "clips=1,seed=3,frames=2,cameras=1"
    work = generate(tiny, str(tmp_path)).work
    next(work)
    with pytest.raises(DatasetError, match="no clip"):
        open_dataset(str(tmp_path)).sequences()
    with pytest.raises(DatasetError, match="another clip"):
        next(generate(tiny.replace("frames=2", "frames=1"), str(tmp_path)).work)
    assert sum(1 for _ in generate(tiny, str(tmp_path)).work) == 2
    names = sorted(path.name for path in (tmp_path / "clip_0000").iterdir())
    assert names == ["calibration.json", "camera_0", "truth.json"]
    assert open_dataset(str(tmp_path)).info(CLIP).number_of_frames == 2


def test_files_of_others_are_not_written_over(tmp_path: Path) -> None:
    other = tmp_path / "clip_0000" / "camera_0" / "rgb" / "000000.png"
    other.parent.mkdir(parents=True)
    other.write_bytes(b"mine")
    with pytest.raises(DatasetError, match="give another folder"):
        next(generate(SMALL, str(tmp_path)).work)
    assert other.read_bytes() == b"mine"


def test_a_dry_run_looks_at_clips_that_are_not_written_yet(tmp_path: Path) -> None:
    places = ("--root", tmp_path / "clips", "--store", tmp_path / "store")
    given = ("--dataset", "cater", "--generate", SMALL, *places, "--preset", "tabletop")
    assert "6 of 6 units to make" in done("build", *given, "--dry-run").err
    assert list(tmp_path.iterdir()) == []


def camera(**changes: Any) -> dict[str, Any]:
    plain = {
        "width_px": 320,
        "height_px": 240,
        "intrinsics_px": [350.0, 350.0, 160.0, 120.0],
        "world_T_camera": np.eye(4).tolist(),
    }
    return {"cameras": [{**plain, **changes}]}


def thing(poses: Any, size_m: tuple[float, ...] = (1.0, 1.0, 1.0)) -> dict[str, Any]:
    plain = {"object_id": "a", "shape": "box", "size_m": size_m}
    return {"objects": [{**plain, "world_T_object": poses}]}


STILL = [np.eye(4).tolist()] * 3
MIRRORED = [np.diag([-1.0, 1.0, 1.0, 1.0]).tolist()] * 3
LOST = [(np.eye(4) + np.diag([np.inf], 3)).tolist()] * 3


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("calibration.json", {"cameras": []}, "needs a camera"),
        ("calibration.json", {"cameras": [{"width_px": 320}]}, "'intrinsics_px' is missing"),
        ("calibration.json", camera(intrinsics_px=[np.nan, 350, 160, 120]), "above 0"),
        ("calibration.json", camera(intrinsics_px=[350, 350, np.inf, 120]), "finite"),
        ("calibration.json", camera(width_px=0), "above 0"),
        ("calibration.json", camera(width_px=np.inf), "infinity"),
        ("calibration.json", camera(world_T_camera=MIRRORED[0]), "no rigid pose"),
        ("truth.json", thing(STILL[:2]), "has 2 poses; the clip's frames go to 2"),
        ("truth.json", thing(MIRRORED), "no rigid pose"),
        ("truth.json", thing(LOST), "no rigid pose"),
        ("truth.json", thing(STILL, (1.0, 1.0, np.inf)), "size"),
        ("calibration.json", {"depth_unit_m": 0}, "above 0"),
        ("truth.json", {"objects": [{"object_id": "a", "shape": "torus"}]}, "torus"),
        ("truth.json", {"containments": [{"inner": "x", "outer": "y"}]}, "no object"),
    ],
)
def test_a_broken_file_is_named(
    copied: Path, name: str, change: dict[str, Any], message: str
) -> None:
    path = copied / "clip_0000" / name
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    cater: Cater = open_dataset(str(copied))
    with pytest.raises(DatasetError, match=message):
        cater.frames(CLIP) if name == "calibration.json" else cater.ground_truth(CLIP)


def test_a_folder_without_clips_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no clip"):
        open_dataset(str(tmp_path)).sequences()
