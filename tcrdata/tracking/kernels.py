"""How loops over points are compiled: once, cached on disk, without the interpreter's lock."""

from __future__ import annotations

from tcrdata.geometry.kernels import kernel

compiled = kernel(nogil=True, error_model="numpy")
"""For loops that count, choose or sample."""

reordered = kernel(nogil=True, error_model="numpy", fastmath=True)
"""The same; sums may be taken in another order, several numbers at once. Knows no NaN."""
