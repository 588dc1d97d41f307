"""How loops over points are compiled: once, cached on disk, without the interpreter's lock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

compiled: Callable[[Function], Function] = numba.njit(cache=True, nogil=True, error_model="numpy")
"""For loops that count, choose or sample."""

reordered: Callable[[Function], Function] = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath=True
)
"""The same; sums may be taken in another order, several numbers at once. Knows no NaN."""
