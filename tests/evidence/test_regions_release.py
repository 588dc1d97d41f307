from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plane_world import PROJECTION, MemoryTables, cue_input, frame, without_image

from tcrdata.evidence import regions_release
from tcrdata.evidence.moving_points import MovingPoints
from tcrdata.evidence.regions_release import Settings, cut, measure


def blob(low: tuple[int, int, int], high: tuple[int, int, int]) -> np.ndarray:
    """Centres of the voxels of 0.125 m from low to high, the latter left out."""
    axes = [np.arange(a, b) for a, b in zip(low, high, strict=True)]
    return (np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3) + 0.5) * 0.125


def points(
    xyz: np.ndarray, px: Any, cosine: Any, motion_3d_m: Any = np.nan, scale: float = 1.0
) -> MovingPoints:
    count = len(xyz)
    projection = np.array(PROJECTION, dtype=float)
    uv = xyz[:, :2] / xyz[:, 2:] * 100 + (80, 60)
    return MovingPoints(
        frame=frame(0),
        metric_scale=scale,
        xyz=xyz.astype(np.float32),
        indices=np.arange(count) + 7,
        pixels=np.clip(np.floor(uv + 0.5), 0, (159, 119)).astype(np.int64),
        motion_3d_m=np.broadcast_to(np.float32(motion_3d_m), count),
        motion_2d_px=np.broadcast_to(np.float32(px), count),
        cosine=np.broadcast_to(np.float32(cosine), count),
        heights_m=None,
        projection=projection,
        size_px=(160, 120),
    )


def rows_of(found: MovingPoints, settings: Settings | None = None) -> list[dict[str, Any]]:
    tables = MemoryTables()
    tables.add(measure(found, settings or Settings()))
    return tables.rows.get("proposals", [])


BLOB = blob((0, 0, 40), (8, 6, 44))  # 192 voxels, 1 x 0.75 x 0.5 m, 5 m ahead


def test_a_solid_moving_block_is_one_region_with_all_its_voxels() -> None:
    (row,) = rows_of(points(BLOB, px=12.0, cosine=0.1))
    assert (row["voxels_a"], row["voxels_b"], row["size_rank"]) == (192, 192, 1)
    assert row["smallest_side_voxels"] == 3
    assert row["motion_2d_px"] == 12
    assert row["motion_3d_m"] is None
    assert (row["source"], row["fit"]) == ("release", "min_area")
    # Voxel centres: 7, 5 and 3 steps of 0.125 m apart.
    assert (row["length_m"], row["width_m"]) == pytest.approx((0.875, 0.375))
    assert row["height_m"] == pytest.approx(0.625)
    assert row["point_indices"] == (np.arange(192) + 7).tolist()
    # At 5.06 to 5.44 m a voxel of 0.125 m is 2.3 to 2.5 px.
    assert row["smallest_side_px"] == pytest.approx(5 * 2.47 + 1, abs=2)
    assert 4 < row["projected_px"] <= 192


def test_b_shapes_the_region_and_a_is_counted_in_it() -> None:
    cosine = np.where(BLOB[:, 0] < 0.5, 0.1, 0.95)
    (row,) = rows_of(points(BLOB, px=12.0, cosine=cosine))
    assert (row["voxels_a"], row["voxels_b"]) == (96, 192)


def test_a_residual_of_eight_pixels_is_not_enough() -> None:
    assert not rows_of(points(BLOB, px=8.0, cosine=0.1))


def test_voxels_beside_a_point_that_the_egomotion_explains_are_left_out() -> None:
    static = blob((8, 0, 40), (9, 6, 44))  # touches the block's last layer along x
    xyz = np.concatenate([BLOB, static])
    moves = np.arange(len(xyz)) < len(BLOB)
    (row,) = rows_of(
        points(
            xyz,
            px=np.where(moves, 12.0, 0.5),
            cosine=np.where(moves, 0.1, 1.0),
            motion_3d_m=np.where(moves, 2.0, 0.1),
        )
    )
    assert row["voxels_b"] == 192 - 24
    assert row["motion_3d_m"] == 2.0


def test_an_unexplained_neighbour_takes_nothing_away() -> None:
    static = blob((8, 0, 40), (9, 6, 44))
    xyz = np.concatenate([BLOB, static])
    moves = np.arange(len(xyz)) < len(BLOB)
    (row,) = rows_of(
        points(xyz, px=np.where(moves, 12.0, 0.5), cosine=0.1, motion_3d_m=np.where(moves, 2, 0.3))
    )
    assert row["voxels_b"] == 192


def test_regions_are_ranked_by_their_voxels_and_none_is_gated() -> None:
    flat = blob((-20, 0, 40), (-12, 1, 44))
    xyz = np.concatenate([flat, BLOB])
    first, second = rows_of(points(xyz, px=12.0, cosine=0.1))
    assert (first["voxels_b"], first["size_rank"]) == (192, 1)
    assert (second["voxels_b"], second["size_rank"]) == (32, 2)
    assert second["smallest_side_voxels"] == 0  # one voxel thick
    assert first["proposal_id"] == "plane/a/000000/release/000/min_area"
    assert second["region_id"] == "plane/a/000000/release/001"


def test_components_of_a_few_voxels_are_not_measured() -> None:
    assert not cut(points(BLOB[:3], px=12.0, cosine=0.1), Settings())
    assert len(cut(points(BLOB[:4], px=12.0, cosine=0.1), Settings())) == 1


def test_voxels_follow_the_metric_scale() -> None:
    (row,) = rows_of(points(BLOB * 0.2, px=12.0, cosine=0.1, scale=0.2))
    assert row["voxels_b"] == 192
    assert row["length_m"] == pytest.approx(0.175, abs=1e-6)


def test_a_frame_without_moving_points_has_no_rows() -> None:
    assert not rows_of(points(BLOB, px=1.0, cosine=1.0))
    assert not rows_of(points(BLOB[:0], px=12.0, cosine=0.1))


def test_without_images_there_are_no_rows() -> None:
    frames = [without_image(0), without_image(1)]
    cue = cue_input(None, MemoryTables(), Settings(), frames)
    assert not list(regions_release.run(cue))
