"""What no export begins with: datasets, sequences and labels that are not there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from tcrdata.errors import MissingEvidenceError, SettingsError, TcrdataError
from tcrdata.types import BoolArray

if TYPE_CHECKING:
    from tcrdata.exporters.labels import ChosenLabels, ExportOptions, SequenceLabels


def check_dataset(known: Sequence[str], options: ExportOptions) -> None:
    """Refuse a dataset that the selection did not read: SettingsError."""
    if options.dataset is not None and options.dataset not in known:
        raise SettingsError(
            f"--dataset: the selection read nothing of '{options.dataset}': "
            f"there is {', '.join(known)}"
        )


def check_validation(known: Sequence[str], options: ExportOptions, *, splits: bool) -> None:
    """Refuse a validation split of other sequences, or in a format without splits: SettingsError.

    Args:
        known: the sequences of the export.
        options: name those of the validation split.
        splits: whether the format has them.
    """
    if options.validation and not splits:
        raise SettingsError(
            "--validation: this format has no splits: leave it away, or export sequences apart "
            "with --where; kitti, mmdet3d, openpcdet and yolo have splits"
        )
    if unknown := sorted(set(options.validation) - set(known)):
        raise SettingsError(
            f"--validation names '{unknown[0]}', which is no sequence of the export: there are "
            f"{', '.join(known)}"
        )


def check_name(owners: dict[str, str], part: SequenceLabels) -> None:
    """Refuse a second dataset's sequence of one name: its files would replace the first's.

    Args:
        owners: sequence to dataset of those written so far; gets this one.
        part: the sequence.

    Raises:
        TcrdataError: another dataset has a sequence of this name.
    """
    other = owners.setdefault(part.sequence, part.dataset)
    if other != part.dataset:
        raise TcrdataError(
            f"{other} and {part.dataset} both have a sequence '{part.sequence}': "
            f"export one dataset at a time: add --dataset {part.dataset}"
        )


def check_images(what: str, chosen: ChosenLabels) -> None:
    """Refuse to write a format of images where no frame has one: MissingEvidenceError."""
    if not chosen.images:
        raise MissingEvidenceError(
            f"{what} labels images, and none of the {chosen.frames} frames has one: "
            "export a format of 3D boxes instead, such as kitti-tracking or nuscenes"
        )


def check_shown(
    what: str, chosen: ChosenLabels, written: Callable[[SequenceLabels], BoolArray]
) -> None:
    """Refuse a format of what images show where they show no positive label.

    Args:
        what: the format.
        chosen: the labels.
        written: (N,) which labels of a sequence the format holds.

    Raises:
        MissingEvidenceError: it would hold none.
    """
    if chosen.in_images:
        return
    for part in chosen.sequences(files=False):
        if (written(part) & part.positive).any():
            return
    raise MissingEvidenceError(
        f"{what} holds what images show, and none shows one of the {chosen.total} labels: export a "
        "format of 3D boxes instead, such as kitti-tracking or openpcdet, or see what drops the "
        f"others with `tcrdata funnel {chosen.asked}`"
    )


def no_labels(selection: dict[str, Any], options: ExportOptions, asked: str) -> Exception:
    """Return the error of an empty export: why there is nothing, and where to look.

    Args:
        selection: its row of `selections`.
        options: of the export.
        asked: the options of `tcrdata funnel` for this selection.
    """
    name, labels = selection["selection_id"], selection["labels"]
    if options.where is not None and labels:
        why = f"--where '{options.where}' keeps no positive label of selection '{name}'"
    elif options.dataset is not None:
        why = f"selection '{name}' has no positive labels of dataset '{options.dataset}'"
    else:
        why = f"selection '{name}' has no positive labels to export"
    counts = (
        f"{selection['proposals_judged']} proposals judged, {labels} labels, "
        f"{selection['ignored'] or 0} left undecided"
    )
    return MissingEvidenceError(
        f"{why} ({counts}): see what drops them with `tcrdata funnel {asked}`"
    )
