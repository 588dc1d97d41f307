"""A store in memory and a store on disk."""

from __future__ import annotations

import itertools

import pytest

from tcrdata.store import Store, open_store

_numbers = itertools.count()


@pytest.fixture(params=["file", "memory"])
def store(request, tmp_path) -> Store:
    """The same test on the local disk and on another fsspec filesystem."""
    url = str(tmp_path / "store") if request.param == "file" else f"memory://s{next(_numbers)}"
    return open_store(url, create=True)


@pytest.fixture
def disk(tmp_path) -> Store:
    return open_store(str(tmp_path / "store"), create=True)
