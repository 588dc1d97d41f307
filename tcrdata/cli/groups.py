"""The commands that have others below them."""

from __future__ import annotations

from tcrdata.cli import evaluate, evaluate_flow, evaluate_tracking, train, train_flow
from tcrdata.cli.app import group

evaluate_commands = group(
    evaluate.evaluate,
    flow=evaluate_flow.evaluate_flow,
    tracking=evaluate_tracking.evaluate_tracking,
)
train_commands = group(train.train, flow=train_flow.train_flow)
