"""What workers that track are forked with: libraries and trackers imported, the compiler set up.

As `tcrdata.evidence.preloading`, for the server's workers that follow objects.
"""

from __future__ import annotations

import gc

gc.disable()

import numpy as np  # noqa: E402

import tcrdata.track_runs  # noqa: E402, F401
from tcrdata.tracking.cell_points import cell_points  # noqa: E402

# The first call of any kernel sets up the compiler.
cell_points(np.zeros((1, 3), np.float32))

gc.freeze()
gc.enable()
