"""Numbers of a sequence's frames, those included of which every file is missing."""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

from tcrdata.errors import DatasetError

# Drives and clips are far shorter: a leap so long is a file with a wrong number.
_LONGEST_GAP = 10_000


def consecutive_numbers(found: Collection[int], place: object) -> list[int]:
    """Return every number from the first to the last of those that have a file, rising.

    Args:
        found: numbers that a file has.
        place: where the files are, for the error.

    Raises:
        DatasetError: a gap is so long that a file must have a wrong number.
    """
    rising = sorted(found)
    for before, after in pairwise(rising):
        if after - before > _LONGEST_GAP:
            raise DatasetError(
                f"{place}: frame {before} is followed by frame {after}: a file has a wrong number; "
                "rename it, or give each part a folder of its own"
            )
    return list(range(rising[0], rising[-1] + 1)) if rising else []
