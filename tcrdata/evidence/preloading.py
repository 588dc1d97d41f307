"""What workers are forked with: libraries and cues imported, the compiler set up.

The server that forks the workers imports this by name, and nothing else does: it is the one module
that works when it is imported, since that is all such a server can be asked to do. It has what
every build from sweeps or depth images begins with: no worker waits for what another preset reads.
"""

from __future__ import annotations

import gc

# Nothing that is imported is garbage, and workers share it: looking through it again and again
# takes time, and takes their own copy of every page.
gc.disable()

import kiss_icp.pybind.kiss_icp_pybind  # noqa: E402, F401
import numpy as np  # noqa: E402
import pypatchworkpp  # noqa: E402, F401
import scipy.linalg.lapack  # noqa: E402
import scipy.ndimage  # noqa: E402
import scipy.optimize  # noqa: E402, F401

import tcrdata.evidence.tracks  # noqa: E402, F401
from tcrdata.evidence.alignment import sort_by_cell  # noqa: E402

# The first call of any kernel sets up the compiler: once here instead of in every worker.
sort_by_cell(np.zeros((1, 3), np.float32), 1.0)

gc.freeze()
gc.enable()
