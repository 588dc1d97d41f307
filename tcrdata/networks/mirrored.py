"""A detector's word on a scene and on its mirror image: their mean varies less than either."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch

Outputs = dict[str, torch.Tensor]

_SIGNS = {"axis": (1.0, -1.0), "direction": (-1.0, 1.0)}
_LEAST = 1e-6


def mirrored_mean(
    network: Callable[[torch.Tensor], Mapping[str, torch.Tensor]], image: torch.Tensor
) -> Outputs:
    """Return the mean of a network's outputs for an image and for its mirror image.

    Probabilities of a centre are averaged, of the others raw numbers.

    Args:
        network: a detector whose last axis is x.
        image: (B, channels, [layers,] rows, columns).
    """
    straight, other = network(image), unmirrored(network(image.flip(-1)))
    mean = {name: (output + other[name]) / 2 for name, output in straight.items()}
    heat = (torch.sigmoid(straight["center"]) + torch.sigmoid(other["center"])) / 2
    mean["center"] = torch.logit(heat.clamp(_LEAST, 1 - _LEAST))
    return mean


def unmirrored(outputs: Mapping[str, torch.Tensor]) -> Outputs:
    """Return what outputs for a mirror image say of the scene: x becomes -x, yaw pi - yaw."""
    flipped = {name: output.flip(-1) for name, output in outputs.items()}
    signs = {"offset": (-1.0,) + (1.0,) * (outputs["offset"].shape[1] - 1), **_SIGNS}
    for name, own in signs.items():
        if name in flipped:
            shape = (1, -1) + (1,) * (flipped[name].ndim - 2)
            flipped[name] = flipped[name] * flipped[name].new_tensor(own).view(shape)
    if "heading" in flipped:
        bins = flipped["heading"].shape[1]
        flipped["heading"] = flipped["heading"][:, (bins // 2 - 1 - torch.arange(bins)) % bins]
    return flipped
