"""What estimates flow: OpenCV's DIS, or RAFT with the weights of a model in a store.

DIS is Kroeger et al., "Fast optical flow using dense inverse search", ECCV 2016; RAFT is Teed and
Deng, "RAFT: recurrent all-pairs field transforms for optical flow", ECCV 2020.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from tcrdata.types import Float32Array, ImageArray

METHODS = ("dis", "raft")

_LEAST_DIS_PX = 16
"""OpenCV's DIS fails, or ends the process, on images of fewer rows."""


class Estimator(Protocol):
    """Picklable, so that workers get it whole."""

    @property
    def method(self) -> str:
        """Value of the column `method`."""
        ...

    def both_ways(self, first: ImageArray, second: ImageArray) -> tuple[Float32Array, Float32Array]:
        """Return flow from the first image to the second and back, each (H, W, 2) px.

        Args:
            first: (H, W, 3) RGB, or (H, W) grey.
            second: of the same size.
        """
        ...


@dataclass(frozen=True)
class Dis:
    """Dense inverse search on grey images."""

    method: str = "dis"

    def both_ways(self, first: ImageArray, second: ImageArray) -> tuple[Float32Array, Float32Array]:
        """See `Estimator`."""
        import cv2

        # DIS splits the image by thread, so that its result could depend on their number.
        cv2.setNumThreads(1)
        here, there = _gray(first), _gray(second)
        return dis_flow(here, there), dis_flow(there, here)


@dataclass(frozen=True)
class Raft:
    """RAFT on colour images.

    Attributes:
        model_id: the model in the store; empty for weights from elsewhere.
        plain: the network's settings as JSON.
        weights: its state dict as `torch.save` writes it.
        iterations: corrections of the flow.
        threads: torch's.
        device: torch's; empty for the GPU where there is one.
        method: value of the column `method`.
    """

    model_id: str
    plain: str
    weights: bytes
    iterations: int
    threads: int = 1
    device: str = ""
    method: str = "raft"

    def both_ways(self, first: ImageArray, second: ImageArray) -> tuple[Float32Array, Float32Array]:
        """See `Estimator`."""
        import torch

        torch.set_num_threads(self.threads)
        device = self.device or ("cuda" if torch.cuda.is_available() else "cpu")
        colours = np.concatenate([_colours(first), _colours(second)], axis=2)
        pair = torch.from_numpy(np.moveaxis(colours, 2, 0).astype(np.float32) / 255)[None]
        with torch.inference_mode():
            flows = _network(self, device)(pair.to(device))["flow"][:, -1]
        forward, backward = np.moveaxis(flows.float().cpu().numpy(), 1, 3)
        return np.ascontiguousarray(forward), np.ascontiguousarray(backward)


def dis_flow(gray_from: ImageArray, gray_to: ImageArray) -> Float32Array:
    """Return the (H, W, 2) flow in pixels between two (H, W) grey images, DIS preset MEDIUM.

    What is smaller than DIS can take has its edges repeated below and right.
    """
    import cv2

    height, width = gray_from.shape
    missing = ((0, max(0, _LEAST_DIS_PX - height)), (0, max(0, _LEAST_DIS_PX - width)))
    if any(after for _, after in missing):
        gray_from, gray_to = (np.pad(gray, missing, mode="edge") for gray in (gray_from, gray_to))
    estimator = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow = np.asarray(estimator.calc(gray_from, gray_to, None), dtype=np.float32)
    return np.ascontiguousarray(flow[:height, :width])


@lru_cache(maxsize=2)
def _network(model: Raft, device: str) -> Any:
    """Return the network of a model on a device; made once a worker."""
    from tcrdata.networks.trained import trained_network

    plain = json.loads(model.plain)
    what = f"model {model.model_id}" if model.model_id else "the weights"
    trained = trained_network("raft", plain, model.weights, what)
    trained.network.settings = replace(
        trained.settings, iterations=model.iterations, both_ways=True
    )
    return trained.network.to(device)


def _gray(image: ImageArray) -> ImageArray:
    import cv2

    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))


def _colours(image: ImageArray) -> ImageArray:
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
