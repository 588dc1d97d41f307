"""The tables of one sequence, as cues get them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pyarrow as pa

if TYPE_CHECKING:
    from tcrdata.store.store import Store


@dataclass(frozen=True)
class SequenceTables:
    """The tables of one sequence and round; satisfies `tcrdata.types.Tables`."""

    store: Store
    dataset: str
    sequence: str
    round: int

    def read(self, table: str, columns: Sequence[str] | None = None, **equals: Any) -> pa.Table:
        """Rows of this sequence and round; see `Store.read`."""
        return self.store.read(
            table,
            columns=columns,
            dataset=self.dataset,
            sequence=self.sequence,
            round=self.round,
            **equals,
        )
