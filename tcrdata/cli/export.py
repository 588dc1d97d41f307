"""`tcrdata export`: labels in another program's format."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from typing import Annotated, Literal

from cyclopts import Parameter

from tcrdata import console
from tcrdata.cli.app import Flag, StoreUrl, listed
from tcrdata.cli.selected import selected, tracked
from tcrdata.errors import SettingsError


def export(
    format_name: Annotated[str, Parameter(name="FORMAT")],
    *,
    store: StoreUrl,
    out: str,
    selection: str | None = None,
    snapshot: str | None = None,
    where: str | None = None,
    ignore: Literal["keep", "drop"] = "keep",
    category: str = "Car",
    dataset: str | None = None,
    validation: str | None = None,
    labels_only: Flag = False,
    tracklets: Flag = False,
    overwrite: Flag = False,
    json: Flag = False,
) -> int:
    """Write a selection's labels in another program's format; prints how it is to be read.

    Args:
        format_name: kitti, kitti-tracking, mot, openpcdet, mmdet3d, nuscenes, coco, yolo, parquet,
            webdataset, or the dotted path of an exporter.
        store: folder or URL of the store.
        out: folder to write into.
        selection: name or id; the newest when left out, with --tracklets the newest tracked one.
        snapshot: only the labels and frames of this snapshot; those of this moment when left out.
        where: SQL condition over the columns of labels: only those that fulfil it are written.
        ignore: keep writes undecided labels as the format's ignore regions, drop leaves them out.
        category: type of every object: the labels have no class.
        dataset: only the sequences of this dataset.
        validation: sequences of the validation split, with commas between: kitti, openpcdet,
            mmdet3d and yolo have splits.
        labels_only: write no images and no points, nor links to them.
        tracklets: write what `tcrdata track` made of the labels: kitti-tracking and mot.
        overwrite: write into a folder that is not empty.
        json: print what was written as JSON.
    """
    from tcrdata import registry
    from tcrdata.exporters.labels import ExportOptions
    from tcrdata.store import open_store

    if tracklets and format_name not in ("kitti-tracking", "kitti_tracking", "mot"):
        raise SettingsError(
            f"--tracklets: {format_name} has no objects over time: export kitti-tracking or mot"
        )
    exporter = registry.find("exporters", format_name)
    opened = open_store(store)
    if snapshot is not None:
        opened = opened.at(snapshot)
    chosen = (tracked if tracklets else selected)(opened, selection)
    options = ExportOptions(
        where=where,
        ignore=ignore,
        category=category,
        dataset=dataset,
        overwrite=overwrite,
        validation=listed(validation) or (),
        labels_only=labels_only,
        tracklets=tracklets,
    )
    card = exporter.export(opened, chosen, out, options)
    if json:
        console.print_json(dataclasses.asdict(card))
    else:
        sys.stdout.write(card.text() + "\n")
    console.say(f"next: tcrdata funnel --store {shlex.quote(store)} --selection {chosen}")
    return 0
