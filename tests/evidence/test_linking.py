"""Linking: who gets which cluster."""

from __future__ import annotations

import numpy as np

from tcrdata.evidence.linking import Detections, LinkingSettings, link


def detections(rows, missing=()):
    """Rows (frame, x, z, size, core share), sorted by frame."""
    rows = sorted(rows, key=lambda row: row[0])
    table = np.array(rows, dtype=float).reshape(-1, 5)
    usable = np.array([frame for frame in range(100) if frame not in missing])
    return Detections(table[:, 0].astype(int), table[:, 1:3], table[:, 3], table[:, 4], usable)


def labels_of(rows, missing=(), **settings):
    return link(detections(rows, missing), LinkingSettings(**settings))


def test_nothing_gives_nothing():
    assert len(labels_of([])) == 0


def test_crossing_objects_keep_their_tracks():
    rows = []
    for t in range(20):
        rows.append((t, -5 + 0.5 * t, 10.0, 4, 1.0))
        rows.append((t, 0.0, 5 + 0.5 * t + 0.2, 4, 1.0))
    labels = labels_of(rows).reshape(20, 2)
    assert (labels[:, 0] == labels[0, 0]).all()
    assert (labels[:, 1] == labels[0, 1]).all()


def test_three_misses_are_bridged_and_four_are_not():
    def rows(missing):
        return [(t, 1.0 * t, 0.0, 4, 1.0) for t in range(20) if t not in missing]

    assert labels_of(rows({8, 9, 10})).max() == 0
    assert labels_of(rows({8, 9, 10, 11})).max() == 1


def test_frames_that_are_missing_are_no_misses():
    gap = set(range(8, 16))
    straight = [(t, 1.0 * t, 0.0, 4, 1.0) for t in range(24) if t not in gap]
    assert labels_of(straight, missing=gap).max() == 0
    # It brakes unseen, by more than a gate: half a metre a frame from here on.
    braked = [(t, x - 0.25 * max(t - 7, 0), z, s, c) for t, x, z, s, c in straight]
    assert labels_of(braked, missing=gap).max() == 0
    assert labels_of(braked, missing=gap, gap_gate_m=0.0).max() == 1
    # What was seen once has no speed: nobody knows where it went.
    once = [(7, 0.0, 0.0, 4, 1.0), (16, 9.0, 0.0, 4, 1.0)]
    assert labels_of(once, missing=gap).tolist() == [0, 1]


def test_a_fast_object_is_followed_and_a_jump_is_not():
    assert labels_of([(t, 3.5 * t, 0.0, 4, 1.0) for t in range(6)]).max() == 0
    assert labels_of([(0, 0, 0, 4, 1), (1, 5, 0, 4, 1)]).tolist() == [0, 1]


def test_clutter_cannot_take_a_cluster_from_a_track():
    rows = [(t, 1.0 * t, 0.0, 4, 1.0) for t in range(10)]
    # A single piece of clutter lies nearer to where the object will be than the object was.
    rows.append((4, 4.9, 0.6, 1, 0.1))
    labels = labels_of(rows)
    good = [i for i, row in enumerate(sorted(rows, key=lambda r: r[0])) if row[4] == 1.0]
    assert len(set(labels[good].tolist())) == 1


def test_the_metric_scale_scales_the_gates():
    rows = [(t, 1.0 * t, 0.0, 4, 1.0) for t in range(4)]
    small = link(detections(rows), LinkingSettings(), metric_scale=0.2)
    assert len(set(small.tolist())) == 4
