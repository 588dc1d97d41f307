"""Flow colours: hue by direction, white at rest."""

from __future__ import annotations

import numpy as np

from tcrdata.views.flow_colours import colour_wheel, flow_picture


def picture(u: float, v: float, longest_px: float = 10.0) -> list[int]:
    flow = np.full((1, 1, 2), (u, v), dtype=np.float32)
    return flow_picture(flow, longest_px)[0, 0].tolist()


def test_wheel_of_55_colours() -> None:
    wheel = colour_wheel()
    assert wheel.shape == (55, 3)
    assert wheel[0].tolist() == [1, 0, 0]
    assert wheel[15].tolist() == [1, 1, 0]


def test_directions_have_their_hues() -> None:
    assert picture(0, 0) == [255, 255, 255]
    red, _, blue = picture(10, 0)
    assert red == 255
    assert blue < 60  # to the right: red
    red, green, _ = picture(-10, 0)
    assert red == 0
    assert green > 150  # to the left: cyan
    assert picture(5, 0)[1] > picture(10, 0)[1]  # shorter is paler


def test_longer_than_the_scale_is_darker_and_unknown_black() -> None:
    assert picture(20, 0)[0] == 191
    flow = np.full((2, 2, 2), np.nan, dtype=np.float32)
    assert not flow_picture(flow).any()
    flow[0] = 3.0
    shown = flow_picture(flow, valid=np.array([[True, False], [True, True]]))
    assert shown.any(axis=2).tolist() == [[True, False], [False, False]]
