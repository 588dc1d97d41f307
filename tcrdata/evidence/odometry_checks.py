"""Checks of odometry: do both estimates agree, and does the chain lay sweeps on later ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tcrdata.errors import FrameError
from tcrdata.evidence.alignment import cycle_error, share_with_neighbour
from tcrdata.evidence.chain_alignment import frames_to_lay_on
from tcrdata.evidence.chunks import even_spans
from tcrdata.evidence.point_rows import EncodedPoints, decode_matching, error_rows
from tcrdata.evidence.poses import Poses, chain
from tcrdata.geometry.transforms import rotation_angle, transform_points
from tcrdata.types import CueInput, Dataset, Float32Array, FloatArray, Frame, Rows


@dataclass(frozen=True)
class CheckSettings:
    """How links are checked; metres of this world.

    Attributes:
        frames_later: the alignment is measured so many frames later.
        radius_m: a neighbour this near counts.
        points: most points asked for a neighbour.
        chunk_frames: most frames an item of work.
    """

    frames_later: int
    radius_m: float
    points: int
    chunk_frames: int


@dataclass(frozen=True)
class Link:
    """Both estimates of one motion."""

    frame: int
    frame_to: int
    to_T_from: FloatArray
    from_T_to: FloatArray


@dataclass(frozen=True)
class _Chunk:
    """Links to be checked, with every frame that the checks read."""

    dataset: Dataset
    settings: CheckSettings
    links: tuple[Link, ...]
    later: dict[int, tuple[int, int]]
    poses: Poses
    frames: dict[int, Frame]
    ground: dict[int, EncodedPoints]


@dataclass(frozen=True)
class _Sweep:
    """All points of a frame, and those that are no ground."""

    xyz: Float32Array
    objects: Float32Array


def checked(
    cue: CueInput, links: list[Link], ground: dict[int, EncodedPoints], settings: CheckSettings
) -> Iterator[Rows]:
    """Yield the rows of `egomotions` of some links, in order, and the frames that failed here."""
    failed: dict[int, str] = {}
    for rows, errors in cue.parallel(_check, _chunks(cue, links, ground, settings)):
        yield rows
        failed |= errors
    yield from error_rows(sorted(failed.items()))


def _chunks(
    cue: CueInput, links: list[Link], ground: dict[int, EncodedPoints], settings: CheckSettings
) -> Iterator[_Chunk]:
    poses = chain([(x.frame, x.frame_to, tuple(x.to_T_from.ravel())) for x in links])
    frames = {frame.frame: frame for frame in cue.frames}
    order = sorted({n for x in links for n in (x.frame, x.frame_to)})
    later = frames_to_lay_on(order, poses, settings.frames_later)
    for first, last in even_spans(len(links), largest=settings.chunk_frames, fewest=2):
        part = links[first:last]
        read = sorted({n for x in part for n in (x.frame, later[x.frame][0])})
        yield _Chunk(
            dataset=cue.dataset,
            settings=settings,
            links=tuple(part),
            later={x.frame: later[x.frame] for x in part},
            poses=poses.only(read),
            frames={n: frames[n] for n in read},
            ground={n: ground[n] for n in read if n in ground},
        )


def _check(chunk: _Chunk) -> tuple[Rows, dict[int, str]]:
    """Return the rows of a chunk's links, and the frames that failed; each sweep is read once."""
    kept: dict[int, _Sweep] = {}
    failed: dict[int, str] = {}
    columns: dict[str, list[object]] = {}
    for link in chunk.links:
        kept = {number: sweep for number, sweep in kept.items() if number >= link.frame}
        for number in {link.frame, chunk.later[link.frame][0]} - kept.keys() - failed.keys():
            try:
                kept[number] = _sweep(chunk, number)
            except FrameError as error:
                failed[number] = str(error)
        for name, value in _row(chunk, link, kept).items():
            columns.setdefault(name, []).append(value)
    return Rows("egomotions", columns), failed


def _sweep(chunk: _Chunk, number: int) -> _Sweep:
    xyz = chunk.dataset.read_points(chunk.frames[number]).xyz
    ground = chunk.ground.get(number)
    if ground is None:
        return _Sweep(xyz, xyz)
    # Several times as fast as a mask in brackets.
    return _Sweep(xyz, np.compress(~decode_matching(ground, len(xyz)), xyz, axis=0))


def _row(chunk: _Chunk, link: Link, kept: dict[int, _Sweep]) -> dict[str, object]:
    """Return a row of `egomotions`; what cannot be checked for want of a sweep is None."""
    here, later = kept.get(link.frame), kept.get(chunk.later[link.frame][0])
    return {
        "frame": link.frame,
        "frame_to": link.frame_to,
        "method": "odometry",
        "to_T_from": link.to_T_from.ravel().tolist(),
        "from_T_to": link.from_T_to.ravel().tolist(),
        "translation_m": float(np.linalg.norm(link.to_T_from[:3, 3])),
        "rotation_rad": rotation_angle(link.to_T_from),
        "cycle_error_m": cycle_error(here.xyz, link.to_T_from, link.from_T_to) if here else None,
        **_alignment(chunk, link, here, later),
    }


def _alignment(
    chunk: _Chunk, link: Link, here: _Sweep | None, later: _Sweep | None
) -> dict[str, object]:
    if here is None or later is None:
        return {"alignment_share": None, "alignment_frames": None}
    number, frames_later = chunk.later[link.frame]
    stride = max(-(-len(here.objects) // chunk.settings.points), 1)
    moved = transform_points(chunk.poses.a_T_b(number, link.frame), here.objects[::stride])
    share = share_with_neighbour(moved, later.objects, chunk.settings.radius_m)
    return {"alignment_share": share, "alignment_frames": frames_later}
