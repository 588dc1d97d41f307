"""How loops over points are compiled: once, cached on disk, without the interpreter's lock."""

from __future__ import annotations

from tcrdata.geometry.kernels import kernel

# Without Python's checks for division by zero, loops become vector instructions.
compiled = kernel(nogil=True, error_model="numpy")
