"""Clips drawn by Blender: its job, its process with a stand-in, and, where bpy is, the real one."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_runs import done, refused
from PIL import Image

from tcrdata.datasets.blender_job import Wanted, scene_job
from tcrdata.datasets.blender_process import PYTHON_VARIABLE, interpreter, rendered
from tcrdata.datasets.cater import generate, open_dataset
from tcrdata.datasets.cater_generator import CaterSpec, GeneratedClips
from tcrdata.datasets.scene import View
from tcrdata.errors import DatasetError, RendererError, SettingsError
from tcrdata.geometry.raycasting import cast, place
from tcrdata.types import Camera

CLIP = "clip_0000"
SPEC = "clips=1,seed=3,frames=3,cameras=2"
CLIPS = GeneratedClips(CaterSpec(seed=3, frames=3, cameras=2))

# Takes the interpreter's place: paints each frame in a colour of its own, and fails when asked to.
STAND_IN = """#!{python}
import json, os, shutil, signal, sys
from pathlib import Path
folder = Path(__file__).parent
def asked(name):
    path = folder / name
    return path.read_text() if path.is_file() else ""
if asked("says"):
    print("Traceback (most recent call last):")
    print(asked("says"))
    sys.exit(1)
if "--version" in sys.argv:
    print("noise\\ntcrdata: " + (asked("version") or "5.0.1"))
    sys.exit(0)
from PIL import Image
job = json.load(sys.stdin)
for number, image in enumerate(job["images"]):
    if asked("crashes") == str(number):
        (folder / "crashes").unlink()
        print("Fra:1 rendering", flush=True)
        os.kill(os.getpid(), signal.SIGSEGV)
    path = Path(image["path"])
    if image["kind"] == "geometry":
        shutil.copy(folder / f"{{image['camera']}}_{{image['frame']}}.npy", path)
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = Path(job["part_path"].format(os.getpid()))
        colour = (10 * image["camera"], 20 * image["frame"], job["samples"])
        size = (job["width_px"], job["height_px"])
        Image.new("RGB", size, colour).save(part, format="PNG")
        part.replace(path)
        with (folder / "log").open("a") as log:
            log.write(f"{{image['camera']}}_{{image['frame']}} ")
    print(f"\\ntcrdata: {{number}}", flush=True)
"""


@dataclass(frozen=True)
class StandIn:
    """A program in a folder, whose files say how it behaves."""

    folder: Path

    @property
    def python(self) -> str:
        return str(self.folder / "python")

    def tell(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text)

    def drawn(self) -> list[str]:
        return (self.folder / "log").read_text().split()

    def write(self, root: Path, spec: str = SPEC) -> int:
        return sum(1 for _ in generate(spec, str(root), "blender", {"python": self.python}).work)


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stand-in, with what Blender would see in every frame."""
    folder = tmp_path_factory.mktemp("stand_in")
    program = folder / "python"
    program.write_text(STAND_IN.format(python=sys.executable))
    program.chmod(0o755)
    for camera in range(2):
        for frame in range(3):
            depth, parts = CLIPS.geometry(CLIP, camera, frame)
            seen = np.stack([np.where(parts < 0, 0, depth), parts]).astype(np.float32)
            np.save(folder / f"{camera}_{frame}.npy", seen)
    return folder


@pytest.fixture
def stand_in(prepared: Path, tmp_path: Path) -> StandIn:
    return StandIn(Path(shutil.copytree(prepared, tmp_path / "stand_in")))


@pytest.fixture(scope="module")
def ray_cast(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("ray_cast")
    assert sum(1 for _ in generate(SPEC, str(root)).work) == 6
    return root


def files(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def test_a_job_holds_the_scene_that_the_ray_caster_sees() -> None:
    job = json.loads(json.dumps(scene_job(CLIPS, CLIP, [Wanted(1, 2, Path("x.png"))])))
    assert [image["path"] for image in job["images"]] == [str(Path("x.png").absolute())]
    things, poses = job["things"], job["poses"]["2"]
    assert list(job["poses"]) == ["2"]
    # A plane's sizes are those of its relief for the ray caster.
    sizes = [[0, 0, 0] if t["shape"] == "plane" else t["half_size_m"] for t in things]
    shapes = place([t["shape"] for t in things], sizes, poses, range(len(things)))
    view = job["cameras"][1]
    pose = np.array(view["world_T_camera"])
    fx, fy, cx, cy = view["intrinsics_px"]
    rows, columns = np.mgrid[0 : job["height_px"], 0 : job["width_px"]]
    rays = np.stack([(columns - cx) / fx, (rows - cy) / fy, np.ones(rows.shape)], axis=-1)
    depth, parts = cast(shapes, pose[:3, 3], rays.reshape(-1, 3) @ pose[:3, :3].T)
    expected, seen = CLIPS.geometry(CLIP, 1, 2)
    np.testing.assert_array_equal(parts, seen.ravel())
    np.testing.assert_allclose(depth, expected.ravel(), atol=1e-9)


def test_things_have_the_looks_of_cater() -> None:
    snitch, *others, ground = scene_job(CLIPS, CLIP, [])["things"]
    assert (snitch["shape"], snitch["look"]) == ("sphere", "metal")
    assert {thing["look"] for thing in others} == {"rubber", "metal"}
    assert (ground["shape"], ground["look"]) == ("plane", "ground")
    assert len(set(ground["colour"])) == 1
    assert scene_job(CLIPS, CLIP, [])["lights"] == scene_job(CLIPS, CLIP, [])["lights"]


def test_only_the_pictures_differ(stand_in: StandIn, ray_cast: Path, tmp_path: Path) -> None:
    root = tmp_path / "clips"
    assert stand_in.write(root) == 6
    mine, theirs = files(root), files(ray_cast)
    assert set(mine) == set(theirs)
    different = {name for name in mine if mine[name] != theirs[name]}
    pictures = {f"{CLIP}/camera_{c}/rgb/{f:06d}.png" for c in range(2) for f in range(3)}
    assert different == {*pictures, f"{CLIP}/calibration.json"}
    cater = open_dataset(str(root))
    frame = cater.frames(f"{CLIP}_camera_1")[2]
    assert (cater.read_image(frame) == (10, 40, 4)).all()
    calibration = json.loads(mine[f"{CLIP}/calibration.json"])
    assert calibration["renderer"] == "bpy 5.0.1"
    assert "blender version 1: samples=4,denoise=true" in calibration["source"]


def test_a_crash_is_named_and_what_is_finished_is_kept(stand_in: StandIn, tmp_path: Path) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    stand_in.write(whole)
    (stand_in.folder / "log").unlink()
    stand_in.tell("crashes", "3")
    with pytest.raises(RendererError, match=r"signal SIGSEGV.*its last lines: Fra:1 rendering"):
        stand_in.write(broken)
    assert stand_in.drawn() == ["0_0", "0_1"]
    with pytest.raises(DatasetError, match="no clip"):
        open_dataset(str(broken)).sequences()
    stand_in.write(broken)
    assert stand_in.drawn() == ["0_0", "0_1", "0_2", "1_0", "1_1", "1_2"]
    assert files(broken) == files(whole)


def test_finished_clips_need_no_blender(stand_in: StandIn, tmp_path: Path) -> None:
    stand_in.write(tmp_path / "clips")
    before = files(tmp_path / "clips")
    Path(stand_in.python).unlink()
    assert stand_in.write(tmp_path / "clips") == 6
    assert files(tmp_path / "clips") == before
    with pytest.raises(DatasetError, match="another clip"):
        next(generate(SPEC, str(tmp_path / "clips")).work)


def test_a_build_that_stops_ends_the_process(stand_in: StandIn, tmp_path: Path) -> None:
    work = generate(SPEC, str(tmp_path / "clips"), "blender", {"python": stand_in.python}).work
    next(work)
    work.close()  # type: ignore[attr-defined]
    stand_in.tell("version", "9.9.9")
    with pytest.raises(DatasetError, match=r"begun with bpy 5\.0\.1, this is bpy 9\.9\.9"):
        stand_in.write(tmp_path / "clips")
    assert list((tmp_path / "clips").rglob("*.blender")) == []


@pytest.mark.parametrize(
    ("says", "message"),
    [
        ("ModuleNotFoundError: No module named 'bpy'", "needs bpy, .* pip install"),
        ("ImportError: libxkbcommon.so.0: no such file", "libxkbcommon.so.0.* apt-get install"),
        ("MemoryError", "exit code 1.* its last lines: Traceback .* | MemoryError"),
    ],
)
def test_a_process_that_cannot_begin_says_what_to_do(
    stand_in: StandIn, tmp_path: Path, says: str, message: str
) -> None:
    stand_in.tell("says", says)
    with pytest.raises(RendererError, match=message):
        stand_in.write(tmp_path / "clips")
    assert not (tmp_path / "clips").exists()


def test_another_scene_than_the_ray_casters_is_refused(stand_in: StandIn, tmp_path: Path) -> None:
    shutil.copy(stand_in.folder / "1_0.npy", stand_in.folder / "0_0.npy")
    with pytest.raises(RendererError, match=r"clip_0000 camera 0, frame 0: .* see the same in"):
        stand_in.write(tmp_path / "clips")


def test_options_that_are_wrong_are_named(tmp_path: Path) -> None:
    folder = str(tmp_path)
    with pytest.raises(SettingsError, match="did you mean samples"):
        generate(SPEC, folder, "blender", {"sample": "4"})
    with pytest.raises(SettingsError, match=r"blender\.samples must be above 0"):
        generate(SPEC, folder, "blender", {"samples": "0"})
    with pytest.raises(SettingsError, match="only --renderer blender"):
        generate(SPEC, folder, "raycast", {"samples": "4"})
    with pytest.raises(SettingsError, match="there are blender, raycast"):
        generate(SPEC, folder, "eevee")
    with pytest.raises(SettingsError, match="add --root FOLDER"):
        generate(SPEC, "", "blender")
    with pytest.raises(RendererError, match="nowhere: no Python that runs: No such file"):
        next(generate(SPEC, folder, "blender", {"python": "/nowhere"}).work)


def test_the_command_draws_beside_the_store(stand_in: StandIn, tmp_path: Path) -> None:
    store = ("--preset", "tabletop", "--store", tmp_path / "store")
    given = ("build", "--dataset", "cater", "--generate", SPEC, *store, "--renderer")
    assert "dataset cater has raycast, blender" in refused(*given, "eevee")
    demo = ("build", "--dataset", "demo", *store, "--renderer", "blender")
    assert "add --generate" in refused(*demo)
    assert "6 of 6 units to make" in done(*given, "blender", "--dry-run").err
    assert not (tmp_path / "store-clips").exists()
    stand_in.tell("crashes", "1")
    options = ("--set", f"blender.python={stand_in.python}", "--set", "blender.samples=2")
    assert "SIGSEGV" in refused(*given, "blender", *options)
    assert (tmp_path / "store-clips" / CLIP / "calibration.json.part").is_file()


class SmallClips(GeneratedClips):
    """Clips of 64 x 48 pixels."""

    def view(self, clip: str, camera: int) -> View:
        whole = super().view(clip, camera)
        small = Camera(((70.0, 0, 32.0, 0), (0, 70.0, 24.0, 0), (0, 0, 1.0, 0)), 64, 48)
        return replace(whole, camera=small)


@pytest.mark.skipif(
    PYTHON_VARIABLE not in os.environ and importlib.util.find_spec("bpy") is None,
    reason=f"no bpy here: set {PYTHON_VARIABLE} to the Python that has it",
)
def test_blender_sees_what_the_ray_caster_sees(tmp_path: Path) -> None:
    clips = SmallClips(CLIPS.spec)
    rgb = [Wanted(0, frame, tmp_path / f"{n}_{frame}.png") for n in range(2) for frame in (0, 2)]
    seen = [Wanted(1, 2, tmp_path / "seen.npy", "geometry")]
    how: dict[str, Any] = {"samples": 1, "denoise": False, "threads": 1}
    job = scene_job(clips, CLIP, [*rgb, *seen]) | how | {"part_path": str(tmp_path / "{}.part")}
    assert len(list(rendered(interpreter(), job))) == 5
    for frame in (0, 2):
        first, second = (tmp_path / f"{n}_{frame}.png" for n in range(2))
        assert first.read_bytes() == second.read_bytes()
        pixels = np.asarray(Image.open(first))
        assert pixels.shape == (48, 64, 3)
        assert pixels.std() > 10
    depth, things = np.load(tmp_path / "seen.npy")
    exact, parts = clips.geometry(CLIP, 1, 2)
    assert (things == parts).mean() > 0.998
    same = things == parts
    assert np.quantile(np.abs(depth - exact)[same], 0.999) < 0.003
