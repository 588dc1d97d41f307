"""`tcrdata warm`: kernels compiled ahead."""

from __future__ import annotations

import time

from tcrdata import console


def warm() -> int:
    """Compile the numeric kernels once, so that the first build does not wait for them."""
    from tcrdata.warming import warm

    started = time.perf_counter()
    warm()
    console.say(f"kernels are compiled ({time.perf_counter() - started:.1f} s)")
    return 0
