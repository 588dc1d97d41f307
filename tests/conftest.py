"""Fixtures that every test may use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from kept_frames import kept_frames

# The tests run side by side: pools of threads in each of their processes only wait for one another.
for _pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS"):
    os.environ.setdefault(_pool, "1")

REPOSITORY = Path(__file__).resolve().parents[1]
# Each takes longest as a whole: what begins first does not keep the last process waiting.
LONGEST = (
    "test_notebooks",
    "test_rounds",
    "test_readme",
    "test_pipeline",
    "test_cli",
    "test_flow_commands",
    "test_report",
    "test_damaged_input",
    "test_damage",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first, in this order; the others stay in theirs."""
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.stem, len(places)))


@pytest.fixture(scope="module", autouse=True)
def frames_of_the_module(request: pytest.FixtureRequest) -> Iterator[None]:
    """Cast and draw generated frames once a module, but where making them is what is tested."""
    if request.path.is_relative_to(REPOSITORY / "tests" / "datasets"):
        yield
    else:
        with kept_frames():
            yield


@pytest.fixture(scope="session")
def repository() -> Path:
    return REPOSITORY


@pytest.fixture(scope="session")
def real_data() -> Path:
    folder = REPOSITORY.parent / "shared" / "data"
    if not (folder / "kitti_raw").is_dir():
        pytest.skip(f"the real frames are not beside the checkout ({folder})")
    return folder
