"""What free space shows of things on a table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tcrdata.datasets.cater import open_dataset
from tcrdata.evidence import table_motion
from tcrdata.store.arrays import encode_points
from tcrdata.types import CueInput


class Votes:
    """Two things on a table, seen in three frames: one moved in the last, the other never."""

    def read(self, table: str, **wanted: Any) -> pa.Table:
        if table == "proposals":
            names = ("moves", "stands")
            return pa.table(
                {
                    "proposal_id": [f"{wanted['frame']}/{name}" for name in names],
                    "track_id": names,
                    "point_indices": [[0, 1, 2, 3], [4, 5]],
                }
            )
        free = np.array([0, 0, 0, 1, 0, 0], np.uint8)
        if wanted["frame"] == 2:
            free[:4] = (4, 3, 2, 0)
        votes = free if wanted["cue"] == "votes_free" else np.full(6, 2, np.uint8)
        row = {"codec": "u8", "data": encode_points(votes, "u8"), "number_of_points": 6}
        return pa.Table.from_pylist([{**row, "summary": None}])


def test_what_free_space_shows_of_a_thing_is_told_in_each_frame_and_of_all() -> None:
    cater = open_dataset("clips=1,seed=4,frames=3,cameras=1")
    sequence = cater.sequences()[0]
    cue = CueInput(
        info=cater.info(sequence),
        frames=tuple(cater.frames(sequence)),
        dataset=cater,
        tables=Votes(),  # type: ignore[arg-type]
        settings=table_motion.Settings(frames_share=0.0),
        parallel=map,  # type: ignore[arg-type]
    )
    told = {
        (id_, module): sure
        for rows in table_motion.run(cue)
        for id_, module, sure in zip(
            *(rows.columns[name] for name in ("proposal_id", "module", "confidence")), strict=True
        )
    }
    # Two of its four points were seen through by more frames than saw them there.
    assert {told[f"{n}/moves", "moved"] for n in range(3)} == {0.5}
    assert {told[f"{n}/stands", "moved"] for n in range(3)} == {0.0}
    assert told["0/moves", "free_space"] == pytest.approx(1 / 9)
    assert told["2/moves", "free_space"] == pytest.approx(9 / 17)
