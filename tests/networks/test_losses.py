"""Losses count what is known alone."""

from __future__ import annotations

import math

import pytest
import torch

from tcrdata.networks.losses import center_loss, heading_loss, masked_logistic, weighted_l1


def test_the_masked_logistic_loss_is_that_of_the_equation() -> None:
    logits = torch.tensor([2.0, -1.0, 5.0])
    target = torch.tensor([1.0, 0.0, 0.0])
    mask = torch.tensor([1.0, 1.0, 0.0])
    expected = (math.log(1 + math.exp(-2.0)) + math.log(1 + math.exp(-1.0))) / 2
    assert float(masked_logistic(logits, target, mask)) == pytest.approx(expected)


def test_without_anything_known_the_loss_is_zero_and_finite() -> None:
    logits = torch.full((1, 1, 2, 2), 40.0)
    nothing = torch.zeros_like(logits)
    assert float(masked_logistic(logits, nothing, nothing)) == 0.0
    assert float(center_loss(logits, nothing, nothing)) == 0.0
    assert float(weighted_l1(logits, nothing, nothing)) == 0.0


def test_a_sure_mistake_costs_a_finite_loss_that_grows_with_it() -> None:
    heat = torch.tensor([[[[1.0, 0.0]]]])
    known = torch.ones_like(heat)
    mild = center_loss(torch.tensor([[[[-1.0, -3.0]]]]), heat, known)
    gross = center_loss(torch.tensor([[[[-90.0, 90.0]]]]), heat, known)
    assert float(gross) > 20 * float(mild)
    assert torch.isfinite(gross)


def test_near_a_centre_a_false_peak_costs_less() -> None:
    logits = torch.tensor([[[[5.0, 1.0, 1.0]]]])
    heat = torch.tensor([[[[1.0, 0.7, 0.0]]]])
    near = center_loss(logits, heat, torch.tensor([[[[1.0, 1.0, 0.0]]]]))
    far = center_loss(logits, heat, torch.tensor([[[[1.0, 0.0, 1.0]]]]))
    assert float(near) < float(far)


def test_headings_are_told_by_bins() -> None:
    logits = torch.zeros(1, 16, 1, 2)
    logits[0, 3, 0, 0] = 20.0
    bins = torch.tensor([[[[3.0, 7.0]]]])
    assert float(heading_loss(logits, bins, torch.tensor([[[[1.0, 0.0]]]]))) < 1e-4
    assert float(heading_loss(logits, bins, torch.tensor([[[[0.0, 1.0]]]]))) == pytest.approx(
        math.log(16), rel=1e-4
    )
