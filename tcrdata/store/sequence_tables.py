"""The tables of one sequence, as cues get them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from tcrdata.store.commits import FileEntry

if TYPE_CHECKING:
    import pyarrow as pa

    from tcrdata.store.store import Store


class SequenceTables:
    """The tables of one sequence and round; satisfies `tcrdata.types.Tables`.

    A table's files are listed once, when it is first read: a cue reads a row at a time.
    """

    def __init__(self, store: Store, dataset: str, sequence: str, round: int) -> None:
        self._store = store
        self._keys = {"dataset": dataset, "sequence": sequence}
        self._round = round
        self._entries: dict[tuple[str, int], list[FileEntry]] = {}

    def read(
        self,
        table: str,
        columns: Sequence[str] | None = None,
        *,
        round: int | None = None,
        **equals: Any,
    ) -> pa.Table:
        """Rows of this sequence, of its round unless another is named; see `Store.read`."""
        number = self._round if round is None else round
        listed = (table, number)
        if listed not in self._entries:
            self._entries[listed] = self._store.files(table, round=number, **self._keys)
        keys = {**self._keys, "round": number}
        return self._store.read_files(table, self._entries[listed], columns, keys, equals)
