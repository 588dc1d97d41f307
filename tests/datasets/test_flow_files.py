from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tcrdata.datasets.flow_files import (
    read_flo,
    read_flow_file,
    read_kitti_flow,
    read_ppm,
    write_flo,
    write_kitti_flow,
    write_ppm,
)
from tcrdata.datasets.flow_pairs import find_flow_pairs
from tcrdata.errors import DatasetError


def drawn_flow(height: int = 5, width: int = 7, scale_px: float = 30.0) -> np.ndarray:
    rng = np.random.default_rng(0)
    flow = rng.normal(0, scale_px, (height, width, 2)).astype(np.float32)
    flow[1, 2] = np.nan
    return flow


def test_flo_is_kept_to_the_bit(tmp_path: Path) -> None:
    flow = drawn_flow(scale_px=900)
    write_flo(tmp_path / "a.flo", flow)
    np.testing.assert_array_equal(read_flo(tmp_path / "a.flo"), flow)


def test_flo_has_the_header_that_others_read(tmp_path: Path) -> None:
    import cv2

    flow = np.nan_to_num(drawn_flow())
    write_flo(tmp_path / "a.flo", flow)
    np.testing.assert_array_equal(cv2.readOpticalFlow(str(tmp_path / "a.flo")), flow)


@given(st.floats(-511.9, 511.9), st.floats(-511.9, 511.9))
def test_kitti_keeps_a_flow_to_half_a_step(u: float, v: float) -> None:
    import tempfile

    flow = np.full((2, 3, 2), (u, v), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.png"
        write_kitti_flow(path, flow)
        again = read_kitti_flow(path)
        write_kitti_flow(path, again)
        np.testing.assert_array_equal(read_kitti_flow(path), again)
    np.testing.assert_allclose(again, flow, atol=1 / 128 + 1e-6)


def test_kitti_keeps_what_is_unknown(tmp_path: Path) -> None:
    flow = drawn_flow()
    write_kitti_flow(tmp_path / "a.png", flow)
    found = read_flow_file(tmp_path / "a.png")
    np.testing.assert_array_equal(np.isnan(found), np.isnan(flow))


def test_kitti_refuses_what_does_not_fit(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"600.0 px does not fit"):
        write_kitti_flow(tmp_path / "a.png", np.full((2, 2, 2), 600, np.float32))


def test_ppm_is_kept_to_the_bit(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    write_ppm(tmp_path / "a.ppm", image)
    np.testing.assert_array_equal(read_ppm(tmp_path / "a.ppm"), image)


def test_a_ppm_that_others_wrote_is_read_and_a_damaged_one_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ppm"
    path.write_bytes(b"P6\n# made by hand\n1 2\n255\n" + bytes(range(6)))
    np.testing.assert_array_equal(read_ppm(path), np.arange(6).reshape(2, 1, 3))
    path.write_bytes(b"P6 1 2 255\n" + bytes(5))
    with pytest.raises(DatasetError, match="16 bytes, not 17 for 1x2"):
        read_ppm(path)
    for header in (b"P5 1 2 255\n", b"P6 0 2 255\n", b"P6 1 2 65535\n", b""):
        path.write_bytes(header + bytes(12) if header else b"")
        with pytest.raises(DatasetError, match=r"no binary \.ppm"):
            read_ppm(path)


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.flo", b"nothing", "no .flo file"),
        ("a.flo", b"PIEH" + bytes(8), "no .flo file"),
        ("a.flo", b"PIEH\x02\0\0\0\x02\0\0\0" + bytes(31), "43 bytes, not 44 for 2x2"),
        ("a.flo", b"", "no .flo file"),
        ("a.png", b"nothing", "three 16-bit channels"),
        ("a.png", b"", "three 16-bit channels"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, name: str, data: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DatasetError, match=said):
        read_flow_file(tmp_path / name)
    with pytest.raises(DatasetError, match="cannot be read"):
        read_flow_file(tmp_path / f"none-{name}")


def test_a_png_of_eight_bits_is_no_flow(tmp_path: Path) -> None:
    import cv2

    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(DatasetError, match="16-bit"):
        read_kitti_flow(tmp_path / "a.png")


def write_chairs(folder: Path, stem: str, shape: tuple[int, int] = (5, 7)) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number in (1, 2):
        write_ppm(folder / f"{stem}_img{number}.ppm", np.full((*shape, 3), number, np.uint8))
    write_flo(folder / f"{stem}_flow.flo", drawn_flow(*shape))


def test_pairs_are_found_in_the_layouts_of_their_releases(tmp_path: Path) -> None:
    import cv2

    write_chairs(tmp_path / "FlyingChairs" / "data", "00001")
    kitti = tmp_path / "kitti" / "training"
    image = np.zeros((5, 7, 3), np.uint8)
    for folder in ("flow_occ", "image_2"):
        (kitti / folder).mkdir(parents=True)
    for number in (10, 11):
        cv2.imwrite(str(kitti / "image_2" / f"000000_{number}.png"), image)
    write_kitti_flow(kitti / "flow_occ" / "000000_10.png", drawn_flow())
    for folder in ("other-gt-flow", "other-data"):
        (tmp_path / folder / "Venus").mkdir(parents=True)
    write_flo(tmp_path / "other-gt-flow" / "Venus" / "flow10.flo", drawn_flow())
    for number in (10, 11):
        cv2.imwrite(str(tmp_path / "other-data" / "Venus" / f"frame{number}.png"), image)
    pairs = find_flow_pairs(str(tmp_path))
    assert [(pair.group, pair.name) for pair in pairs] == [
        ("data", "00001_flow"),
        ("flow_occ", "000000_10"),
        ("Venus", "flow10"),
    ]
    for pair in pairs:
        first, _ = pair.read_images()
        np.testing.assert_allclose(pair.read_truth(first.shape), drawn_flow(), atol=0.01)


def test_a_folder_without_pairs_says_what_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"no flow pair: looked for .*flow_occ"):
        find_flow_pairs(str(tmp_path))
    with pytest.raises(DatasetError, match="no such folder"):
        find_flow_pairs(str(tmp_path / "none"))


def test_a_pair_that_lacks_an_image_or_differs_in_size_is_refused(tmp_path: Path) -> None:
    write_chairs(tmp_path, "00001")
    (pair,) = find_flow_pairs(str(tmp_path))
    with pytest.raises(DatasetError, match=r"a flow of 7x5 for images of 8x5"):
        pair.read_truth((5, 8, 3))
    write_ppm(tmp_path / "00001_img2.ppm", np.zeros((5, 9, 3), np.uint8))
    with pytest.raises(DatasetError, match=r"is 7x5 but 00001_img2.ppm is 9x5"):
        pair.read_images()
    (tmp_path / "00001_img2.ppm").unlink()
    with pytest.raises(DatasetError, match=r"00001_img2.ppm is missing"):
        find_flow_pairs(str(tmp_path))


@pytest.mark.real
def test_the_real_pairs_are_found(real_data: Path) -> None:
    pairs = find_flow_pairs(str(real_data / "flow"))
    assert [pair.group for pair in pairs] == ["flying_chairs"] * 4 + ["kitti"]
    known = np.isfinite(pairs[-1].read_truth(pairs[-1].read_images()[0].shape))
    assert 0.1 < known.mean() < 0.2
