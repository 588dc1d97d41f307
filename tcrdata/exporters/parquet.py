"""A Hugging Face dataset: `data/train-*.parquet` with images, and a README.md that is its card.

A row is a frame. `image` is a struct of bytes and path, declared an image in the schema's metadata
under the key `huggingface`, where the `datasets` library looks for features.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tcrdata.exporters.frame_records import (
    FRAME,
    OBJECT,
    conventions,
    named_sequences,
    pictured_records,
    runs_of,
)
from tcrdata.exporters.labels import (
    Card,
    ChosenLabels,
    ExportOptions,
    SequenceLabels,
    chosen_labels,
    open_folder,
)
from tcrdata.store import Store

SHARD_BYTES = 512_000_000
"""A file is closed once its images and records have passed this."""

_FRAMES_A_GROUP = 32
_IMAGE = pa.struct({"bytes": pa.binary(), "path": pa.string()})


def export(
    store: Store,
    selection_id: str,
    out: str | Path,
    options: ExportOptions | None = None,
    *,
    shard_bytes: int = SHARD_BYTES,
) -> Card:
    """Write every frame with its image and its labels; frames without labels too.

    Args:
        store: holds the selection; its dataset's images must still be where the build read them.
        selection_id: of the labels.
        out: folder that gets `data/` and `README.md`.
        options: which labels, and how.
        shard_bytes: size of a file, about.

    Raises:
        TcrdataError: the folder is not empty, or two datasets have a sequence of one name.
        QueryError: the condition of `where` is none.
        MissingEvidenceError: there is no such selection, or no positive label.
        FrameError: an image is gone since the build.
    """
    options = options or ExportOptions()
    with chosen_labels(store, selection_id, options) as chosen:
        folder = open_folder(out, options.overwrite)
        (folder / "data").mkdir(exist_ok=True)
        begun = _write(folder / "data", _groups(chosen, options), shard_bytes)
    _name(folder / "data", begun)
    card = _card(str(out), options, len(begun), chosen)
    (folder / "README.md").write_text(_readme(card, chosen.frames), encoding="utf-8")
    return card


def schema() -> pa.Schema:
    """Return the columns, with the features that `datasets` reads from the metadata."""
    fields = {
        "image": _IMAGE,
        **FRAME,
        "objects": pa.list_(pa.struct(OBJECT)),
    }
    features = {name: _feature(kind) for name, kind in fields.items()}
    about = {"info": {"features": features}}
    return pa.schema(fields, metadata={"huggingface": json.dumps(about)})


def _feature(kind: pa.DataType) -> Any:
    """Return the feature of an Arrow type, in the form that old and new readers share."""
    if kind == _IMAGE:
        return {"_type": "Image"}
    if pa.types.is_list(kind):
        return [_feature(kind.value_type)]
    if pa.types.is_struct(kind):
        return {field.name: _feature(field.type) for field in kind}
    name = {pa.float64(): "float64"}.get(kind, str(kind))
    return {"dtype": name, "_type": "Value"}


def _write(folder: Path, groups: Iterator[pa.Table], limit: int) -> list[Path]:
    """Write a row group for each table into files of about so many bytes; returns their names."""
    begun: list[Path] = []
    for run in runs_of(groups, lambda group: int(group.nbytes), limit):
        begun.append(folder / f"begun-{len(begun):05d}.parquet")
        with pq.ParquetWriter(begun[-1], schema(), compression="zstd") as writer:
            for group in run:
                writer.write_table(group)
    return begun


def _name(folder: Path, begun: list[Path]) -> None:
    """Give each file a name that tells the number of all; those of an earlier export go."""
    for path in folder.glob("train-*.parquet"):
        path.unlink()
    for number, path in enumerate(begun):
        path.rename(folder / f"train-{number:05d}-of-{len(begun):05d}.parquet")


def _groups(chosen: ChosenLabels, options: ExportOptions) -> Iterator[pa.Table]:
    kind = schema()
    for part in named_sequences(chosen):
        rows = _rows(part, options)
        while group := list(islice(rows, _FRAMES_A_GROUP)):
            yield pa.Table.from_pylist(group, schema=kind)


def _rows(part: SequenceLabels, options: ExportOptions) -> Iterator[dict[str, Any]]:
    for record, image in pictured_records(part, options):
        name = f"{part.sequence}/{record['frame']:06d}"
        file = None if image is None else {"bytes": image.data, "path": name + image.suffix}
        yield {"image": file, **record}


def _readme(card: Card, frames: int) -> str:
    """Return the dataset card: the head that tells readers where the data lie, then this card."""
    return f"""---
pretty_name: 3D labels selected by tcrdata
task_categories:
- object-detection
configs:
- config_name: default
  data_files:
  - split: train
    path: data/train-*.parquet
---
# 3D labels selected by tcrdata

{frames} frames, {card.labels} labels, {card.ignored} ignore regions. The images keep the licence
of the dataset that they come from.

```python
from datasets import load_dataset
frames = load_dataset(".", split="train")   # this folder
frames[0]["image"], frames[0]["objects"]
```

## How to read it

""" + "".join(f"- {name}: {text}\n" for name, text in card.conventions)


def _card(out: str, options: ExportOptions, shards: int, chosen: ChosenLabels) -> Card:
    own = (
        ("file", "data/train-*.parquet: a row a frame; README.md is the dataset's card"),
        (
            "images",
            "bytes and path, as the dataset's file has them; NULL in a frame without an image",
        ),
        *conventions(options),
    )
    return Card("parquet", out, shards + 1, chosen.total, chosen.ignored, own)
