"""How an object on the table moves: slides, tilts and carries, eased, one after another."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tcrdata.geometry.raycasting import Shape
from tcrdata.types import FloatArray


@dataclass(frozen=True)
class Move:
    """One eased motion.

    Attributes:
        start_s: when it begins.
        end_s: when it is over.
        target_m: (x, y) at its end, world.
        lift_m: how high the object is carried on the way.
        tilt_rad: by how much it turns about a level axis.
        tilt_axis_rad: where that axis points in the world's plane.
    """

    start_s: float
    end_s: float
    target_m: tuple[float, float]
    lift_m: float = 0.0
    tilt_rad: float = 0.0
    tilt_axis_rad: float = 0.0


@dataclass(frozen=True)
class Script:
    """The moves of an object that otherwise rests on the table.

    Attributes:
        shape: its kind.
        half_size_m: its half extents.
        start_m: (x, y) before the first move.
        yaw_rad: about z before the first move.
        moves: in order, not overlapping.
    """

    shape: Shape
    half_size_m: tuple[float, float, float]
    start_m: tuple[float, float]
    yaw_rad: float
    moves: tuple[Move, ...] = ()

    def pose(self, time_s: float) -> FloatArray:
        """Return `world_T_object` (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_about((0.0, 0.0, 1.0), self.yaw_rad)
        place, lift = np.asarray(self.start_m, dtype=np.float64), 0.0
        for move in self.moves:
            share = float(np.clip((time_s - move.start_s) / (move.end_s - move.start_s), 0.0, 1.0))
            travel = (share - 0.2) / 0.6 if move.lift_m else share
            place = place + ease(travel) * (np.asarray(move.target_m) - place)
            lift += move.lift_m * ease(min(share, 1.0 - share) / 0.35)
            axis = (math.cos(move.tilt_axis_rad), math.sin(move.tilt_axis_rad), 0.0)
            pose[:3, :3] = rotation_about(axis, move.tilt_rad * ease(share)) @ pose[:3, :3]
        pose[:2, 3] = place
        pose[2, 3] = lift + self._support(pose[:3, :3])
        return pose

    def _support(self, rotation: FloatArray) -> float:
        """Height of the centre when the lowest point touches the table."""
        a, b, c = self.half_size_m
        up = np.abs(rotation[2])
        if self.shape == "sphere":
            return a
        if self.shape == "box":
            return float(up @ (a, b, c))
        return float(c * up[2] + a * math.sqrt(max(0.0, 1.0 - up[2] ** 2)))


def ease(share: float) -> float:
    """Return the smooth step of a share of time, clipped to [0, 1]."""
    share = min(1.0, max(0.0, share))
    return share * share * (3.0 - 2.0 * share)


def rotation_about(axis: tuple[float, float, float], angle: float) -> FloatArray:
    """Return the (3, 3) rotation about a unit axis, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: FloatArray = (
        np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * (skew @ skew)
    )
    return turned
