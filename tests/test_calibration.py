"""Calibration: what the other modules say, made to rise with a module's own confidence."""

from __future__ import annotations

from pathlib import Path

import pytest

from tcrdata.calibration import calibrate
from tcrdata.store import Unit, open_store

SAID = {
    "track": [0.05, 0.15, 0.25, 1.0, 0.5],
    "objectness_3d": [0.2, 0.6, 0.4, 0.9, None],
}


def test_calibrated_is_the_isotonic_regression_on_what_the_others_say(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "store"), create=True)
    unit = Unit("tracks", "d", "s", 1)
    with store.writer(unit, settings_hash="0", inputs={}) as writer:
        for module, values in SAID.items():
            writer.append("confidences", {
                "proposal_id": [f"p{i}" for i in range(5)], "frame": [0] * 5, "source": ["x"] * 5,
                "module": [module] * 5, "confidence": values, "raw_value": values,
                "unit": ["share"] * 5,
            })  # fmt: skip
    assert calibrate(store, 2)
    assert not calibrate(store, 2)
    rows = [r for r in store.read("calibrations").to_pylist() if r["module"] == "track"]
    assert [row["confidence_low"] for row in rows] == pytest.approx([0, 0.1, 0.2, 0.9])
    assert [row["proposals"] for row in rows] == [1, 1, 1, 1]
    assert [row["others_confidence"] for row in rows] == pytest.approx([0.2, 0.6, 0.4, 0.9])
    assert [row["calibrated"] for row in rows] == pytest.approx([0.2, 0.5, 0.5, 0.9])
