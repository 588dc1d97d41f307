"""What workers are forked with: the cues' libraries imported, the compiler set up.

The server that forks the workers imports this by name, and nothing else does: it is the one module
that works when it is imported, since that is all such a server can be asked to do.
"""

from __future__ import annotations

import kiss_icp.kiss_icp  # noqa: F401
import numpy as np
import pypatchworkpp  # noqa: F401
import scipy.linalg
import scipy.ndimage
import scipy.optimize
import scipy.spatial.transform  # noqa: F401

from tcrdata import registry
from tcrdata.evidence.alignment import sort_by_cell

for _cue in registry.names("evidence"):
    registry.find("evidence", _cue)
# The first call of any kernel sets up the compiler: once here instead of in every worker.
sort_by_cell(np.zeros((1, 3), np.float32), 1.0)
