"""Kernels: compiled when called, with those they call; who calls none loads no compiler."""

from __future__ import annotations

import subprocess
import sys

from tcrdata.geometry.kernels import kernel


@kernel()
def _twice(value: float) -> float:
    return 2 * value


@kernel(nogil=True)
def _four_times(value: float) -> float:
    return _twice(_twice(value))


def test_a_kernel_calls_another() -> None:
    assert _four_times(1.5) == 6.0
    assert _four_times.__name__ == "_four_times"


def test_importing_cues_loads_no_compiler() -> None:
    code = "import sys, tcrdata.evidence.tracks, tcrdata.datasets.kitti; print(*sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "numba" not in shown.stdout.split()


def test_setting_up_the_compiler_loads_no_linear_algebra() -> None:
    code = (
        "import sys\n"
        "from tcrdata.geometry import kernels\n"
        "kernels._numba()\n"
        "print('scipy.linalg' in sys.modules)\n"
        "import scipy.linalg.cython_blas\n"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout == "False\n"
