"""Image pairs with known flow, found in a folder by looking; for scoring alone.

Layouts: KITTI's development kits, FlyingChairs, Middlebury, and folders of one KITTI pair each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tcrdata.datasets.flow_files import read_flow_file, read_ppm
from tcrdata.datasets.image_files import read_rgb
from tcrdata.errors import DatasetError
from tcrdata.types import Float32Array, ImageArray


@dataclass(frozen=True)
class FlowPair:
    """A pair, not read yet.

    Attributes:
        group: the folder that the pairs of one kind lie in.
        name: of the pair.
        images: paths of both images.
        truth: path of the flow.
    """

    group: str
    name: str
    images: tuple[Path, Path]
    truth: Path

    def read_images(self) -> tuple[ImageArray, ImageArray]:
        """Return both (H, W, 3) RGB images.

        Raises:
            DatasetError: one cannot be read, or they differ in size.
        """
        first, second = (
            read_ppm(path) if path.suffix == ".ppm" else read_rgb(path) for path in self.images
        )
        if first.shape != second.shape:
            sizes = [f"{image.shape[1]}x{image.shape[0]}" for image in (first, second)]
            raise DatasetError(
                f"{self.images[0]} is {sizes[0]} but {self.images[1].name} is {sizes[1]}: "
                "flow needs two images of one size"
            )
        return first, second

    def read_truth(self, shape: tuple[int, ...]) -> Float32Array:
        """Return the (H, W, 2) flow in pixels, NaN where it is not known.

        Raises:
            DatasetError: it cannot be read, or is not of the images' (height, width).
        """
        flow = read_flow_file(self.truth)
        if flow.shape[:2] != shape[:2]:
            raise DatasetError(
                f"{self.truth}: a flow of {flow.shape[1]}x{flow.shape[0]} for images of "
                f"{shape[1]}x{shape[0]}"
            )
        return flow


_Images = Callable[[Path], tuple[Path, Path]]


def _kitti_images(truth: Path) -> tuple[Path, Path]:
    """Of `training/flow_occ/000000_10.png`: colour images, else grey ones."""
    training, second = truth.parent.parent, truth.name.replace("_10.", "_11.")
    folders = [training / name for name in ("image_2", "colored_0", "image_0")]
    folder = next((f for f in folders if (f / truth.name).is_file()), folders[0])
    return folder / truth.name, folder / second


def _beside(*names: str) -> _Images:
    """Images with fixed names in the folder of the truth."""
    return lambda truth: (truth.parent / names[0], truth.parent / names[1])


def _stemmed(ending: str, *endings: str) -> _Images:
    """Images that share the beginning of the truth's name."""

    def images(truth: Path) -> tuple[Path, Path]:
        stem = truth.name.removesuffix(ending)
        return truth.with_name(stem + endings[0]), truth.with_name(stem + endings[1])

    return images


def _middlebury_images(truth: Path) -> tuple[Path, Path]:
    """Of `other-gt-flow/<name>/flow10.flo`: `other-data/<name>/frame10.png` or beside it."""
    apart = truth.parent.parent.with_name("other-data") / truth.parent.name
    folder = apart if apart.is_dir() else truth.parent
    return folder / "frame10.png", folder / "frame11.png"


LAYOUTS: tuple[tuple[str, _Images], ...] = (
    ("flow_occ/*_10.png", _kitti_images),
    ("flow_gt.png", _beside("frame1.png", "frame2.png")),
    ("*_flow.flo", _stemmed("_flow.flo", "_img1.ppm", "_img2.ppm")),
    ("*-gt.flo", _stemmed("-gt.flo", "-img0.ppm", "-img1.ppm")),
    ("flow10.flo", _middlebury_images),
)
"""How truth is named, and where its images lie."""


def find_flow_pairs(root: str) -> list[FlowPair]:
    """Return all pairs below a folder, by path.

    Raises:
        DatasetError: there is no such folder, none holds a pair, or a pair lacks an image.
    """
    folder = Path(root)
    if not folder.is_dir():
        raise DatasetError(f"{root}: no such folder of flow pairs")
    found = {
        truth: images(truth)
        for pattern, images in LAYOUTS
        for truth in sorted(folder.rglob(pattern))
    }
    if not found:
        raise DatasetError(
            f"{root}: no flow pair: looked for {', '.join(pattern for pattern, _ in LAYOUTS)}"
        )
    for truth, images in found.items():
        for path in images:
            if not path.is_file():
                raise DatasetError(f"{truth}: its image {path} is missing: fetch it again")
    return [
        FlowPair(truth.parent.name, truth.name.removesuffix(truth.suffix), images, truth)
        for truth, images in sorted(found.items())
    ]
