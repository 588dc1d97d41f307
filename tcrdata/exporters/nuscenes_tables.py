"""The tables of nuScenes as JSON files, their tokens, and the rows that no drive changes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tcrdata.exporters.json_arrays import JsonArray

TABLES = (
    "category", "attribute", "visibility", "instance", "sensor", "calibrated_sensor", "ego_pose",
    "log", "scene", "sample", "sample_data", "sample_annotation", "map",
)  # fmt: skip
"""Every table of the schema."""

IGNORE = "noise"
"""Category of ignore regions: one that nuScenes has and that no detection class stands for."""

CAMERA, LIDAR = "CAM_FRONT", "LIDAR_TOP"
MAP_FILE = "maps/none.png"

_RIDDEN = ("vehicle.bicycle", "vehicle.motorcycle")

Tables = Mapping[str, JsonArray]


def token(*what: object) -> str:
    """Return the token of what is named: 32 hexadecimal digits, the same in every export."""
    return hashlib.md5("|".join(map(str, what)).encode(), usedforsecurity=False).hexdigest()


@contextmanager
def open_tables(folder: Path) -> Iterator[Tables]:
    """Open every table of a folder for writing, row by row."""
    with ExitStack() as stack:
        files = {
            name: stack.enter_context((folder / f"{name}.json").open("w", encoding="utf-8"))
            for name in TABLES
        }
        tables = {name: JsonArray(file) for name, file in files.items()}
        yield tables
        for table in tables.values():
            table.close()


def attribute_names(category: str) -> tuple[str, str] | None:
    """Return nuScenes' attributes of a moving and of a still object; None where it has none."""
    if category.startswith("human.pedestrian"):
        return "pedestrian.moving", "pedestrian.standing"
    if category.startswith("vehicle.") and category not in _RIDDEN:
        return "vehicle.moving", "vehicle.stopped"
    return None


def write_fixed(tables: Tables, category: str, with_ignored: bool) -> None:
    """Write `category`, `attribute`, `visibility` and `sensor`.

    Args:
        tables: the open tables.
        category: of every positive label.
        with_ignored: whether there are ignore regions.
    """
    described = {category: "Every positive label: the labels have no class."}
    if with_ignored:
        described[IGNORE] = "Ignore region: a label left undecided, neither object nor background."
    tables["category"].extend(
        {"token": token("category", name), "name": name, "description": text}
        for name, text in described.items()
    )
    tables["attribute"].extend(
        {"token": token("attribute", name), "name": name, "description": text}
        for name, text in zip(
            attribute_names(category) or (),
            ("Faster than the bound of the export.", "Slower than it."),
            strict=False,
        )
    )
    levels = ("0-40", "40-60", "60-80", "80-100")
    tables["visibility"].extend(
        {"token": str(n), "level": f"v{level}", "description": f"{level} % of the outline is seen"}
        for n, level in enumerate(levels, 1)
    )
    tables["sensor"].extend(
        {"token": token("sensor", channel), "channel": channel, "modality": modality}
        for channel, modality in ((CAMERA, "camera"), (LIDAR, "lidar"))
    )


def write_map(root: Path, logs: list[str], tables: Tables) -> None:
    """Write the one map that readers want, an empty one: `map` and its picture."""
    from PIL import Image

    (root / MAP_FILE).parent.mkdir(exist_ok=True)
    Image.new("L", (1, 1)).save(root / MAP_FILE)
    row: dict[str, Any] = {
        "token": token("map"),
        "log_tokens": logs,
        "category": "semantic_prior",
        "filename": MAP_FILE,
    }
    tables["map"].extend([row])
