"""Long range: paths of the library scored in the volume of what they may travel through.

`p = min(unproj(s) * o + (1 - v), 1)` (eq. 9): high where something object-like is, or where nobody
can see. s is 2D and o 3D objectness, v visibility by ray casting. A path is as good as its mean p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tcrdata.tracking.library import Library
from tcrdata.tracking.near_points import add_heat
from tcrdata.tracking.scenes import Scene
from tcrdata.tracking.volumes import in_voxels, samples
from tcrdata.types import Float32Array, FloatArray


@dataclass(frozen=True)
class Volume:
    """p of one frame: on a grid, and at any place outside of it.

    Attributes:
        values: (X, Y, Z) float32 at the centres of the voxels.
        low: (3,) the centre of the first voxel.
        voxel_m: side of a voxel.
        scene: the frame.
        margin_m: a place counts as visible unless a return is this much nearer.
    """

    values: Float32Array
    low: FloatArray
    voxel_m: float
    scene: Scene
    margin_m: float


_MOST_VOXELS = 96


def make_volume(scene: Scene, places: FloatArray, voxel_m: float, margin_m: float) -> Volume:
    """Return p of a frame around some places.

    Args:
        scene: its candidates carry s * o as heat, its view casts the rays.
        places: (N, 3) that the grid covers; none: a grid of nothing.
        voxel_m: side of a voxel; more where the places lie farther apart than 96 voxels.
        margin_m: a voxel counts as visible unless a return is this much nearer.
    """
    if not len(places):
        return Volume(np.zeros((0, 0, 0), np.float32), np.zeros(3), voxel_m, scene, margin_m)
    low, high = places.min(axis=0) - voxel_m, places.max(axis=0) + voxel_m
    voxel_m = max(voxel_m, float((high - low).max()) / _MOST_VOXELS)
    counts = np.ceil((high - low) / voxel_m).astype(int) + 1
    axes = [low[i] + voxel_m * np.arange(counts[i]) for i in range(3)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = _passable(scene, centres, margin_m, thick_m=voxel_m / 2)
    return Volume(values.reshape(counts).astype(np.float32), low, voxel_m, scene, margin_m)


def _passable(
    scene: Scene, points: FloatArray, margin_m: float, thick_m: float = 0.0
) -> FloatArray:
    """Return p at (N, 3) points; boxes grow by `thick_m`, so that no voxel misses a thin one."""
    ranges, nearest = scene.view.nearest(points)
    with np.errstate(invalid="ignore"):
        values = (~(ranges <= nearest + margin_m)).astype(np.float64)
    boxes = scene.candidates.boxes
    halves = boxes[:, [3, 5, 4]] / 2 + thick_m
    reaches = np.hypot(halves[:, 0], halves[:, 2])
    add_heat(values, points, boxes, scene.candidates.turns, halves, reaches, scene.candidates.heat)
    return values


def sample(volume: Volume, points: Float32Array) -> FloatArray:
    """Return (N,) p at (N, 3) points: trilinear in the grid, p itself outside of it."""
    result = samples(volume.values, in_voxels(points, volume.low, volume.voxel_m))
    outside = np.flatnonzero(np.isnan(result))
    if len(outside):
        result[outside] = _passable(
            volume.scene, points[outside].astype(np.float64), volume.margin_m
        )
    # The shares of eight voxels, rounded, may add up to more than 1.
    return np.minimum(result, 1.0)


def score_paths(paths: Float32Array, volumes: Sequence[Volume]) -> FloatArray:
    """Return the mean p along (K, T, 3) paths, step t in volume t: (K,).

    Raises:
        ValueError: not as many volumes as steps.
    """
    if paths.shape[1] != len(volumes):
        raise ValueError(f"{paths.shape[1]} steps need as many volumes, not {len(volumes)}")
    total = np.zeros(len(paths))
    for step, volume in enumerate(volumes):
        total += sample(volume, paths[:, step])
    return total / max(len(volumes), 1)


class Hypotheses:
    """Where an object that is out of sight may be: every path of the library, as time goes on."""

    def __init__(
        self, library: Library, box: FloatArray, velocity: FloatArray, speed_m: float
    ) -> None:
        """Orient the library.

        Args:
            library: its first entry is to stay, its second to go on.
            box: (7,) where the object was seen last.
            velocity: (3,) metres a frame then.
            speed_m: a difference of the first speed by this much, in metres a frame, costs as much
                as one tenth of p.
        """
        self._paths, self._yaws, apart = library.oriented(box, velocity)
        # To go on means in three dimensions: an object may be lifted.
        steps = np.arange(1, self._paths.shape[1] + 1)[:, None]
        self._paths[1] = (box[:3] + steps * velocity).astype(np.float32)
        self._cost = 0.1 * apart / speed_m
        self._cost[:2] = 0.1 * np.array([np.linalg.norm(velocity) / speed_m, 0.5])
        self._size = box[3:6]
        self._sums = np.zeros(len(self._paths))
        self.steps = 0

    @property
    def longest(self) -> int:
        """Number of steps that the paths have."""
        return int(self._paths.shape[1])

    def advance(self, volume: Volume, steps: int = 1) -> None:
        """Go on by some frames, of which the last shows the volume; the others were not seen."""
        if self.steps + steps > self.longest:
            raise ValueError("the paths end here")
        self._sums += steps - 1 + sample(volume, self._paths[:, self.steps + steps - 1])
        self.steps += steps

    def carry(self, motion: FloatArray) -> None:
        """Move the path that stays by (3,) metres from here on: its container moves."""
        self._paths[0, max(self.steps - 1, 0) :] += motion.astype(np.float32)

    @property
    def passable(self) -> FloatArray:
        """(K,) mean p of the paths so far."""
        return np.asarray(self._sums / max(self.steps, 1))

    @property
    def places(self) -> Float32Array:
        """(K, 3) where the paths are now."""
        return self.places_after(self.steps)

    def places_after(self, steps: int) -> Float32Array:
        """Return (K, 3) where the paths are after some steps."""
        return np.asarray(self._paths[:, steps - 1])

    def likeliest(self, count: int) -> list[int]:
        """Return the paths with the largest mean p, less what their first motion differs."""
        worth = self.passable - self._cost
        return [int(path) for path in np.argsort(-worth, kind="stable")[:count]]

    def best(self, prior: FloatArray | float = 0.0) -> int:
        """Return the path with the largest mean p, less what its first motion differs."""
        return int(np.argmax(self.passable - self._cost - prior))

    def box(self, path: int, step: int | None = None) -> FloatArray:
        """Return the (7,) box of a path after some steps; now when left out."""
        place = (self.steps if step is None else step) - 1
        return np.array([*self._paths[path, place], *self._size, self._yaws[path, place]])
