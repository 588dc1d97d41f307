"""Evidence is looser than every rule: a bound can be loosened without measuring anything anew."""

from __future__ import annotations

from functools import reduce

from tcrdata import registry
from tcrdata.rules import load_preset, load_rules, preset_names

BELOW, ABOVE = "below", "above"
COUNTERPARTS = {
    "min_age_frames": [("tracks", "least_sightings", BELOW)],
    "min_age_long_frames": [("tracks", "least_sightings", BELOW)],
    "min_age_cut_frames": [("tracks", "least_sightings", BELOW)],
    "min_travel_m": [("tracks", "least_spread_m", BELOW)],
    "min_travel_long_m": [("tracks", "least_spread_m", BELOW)],
    "min_travel_cut_m": [("tracks", "least_spread_m", BELOW)],
    "min_points": [
        ("regions_free_space", "minimum_points", BELOW),
        ("regions_paper", "smallest_points", BELOW),
        ("table_clusters", "regions.least_pixels", BELOW),
    ],
    "min_points_extended": [("tracks", "fill_points", BELOW)],
    "max_frames_from_observation": [("tracks", "extend_frames", ABOVE)],
    "min_alignment_frames": [
        ("odometry", "alignment_frames", ABOVE),
        ("flow_ransac", "alignment_frames", ABOVE),
    ],
    "motion_level_m": [("regions_paper", "levels_m", BELOW)],
    "min_voxels": [("regions_release", "smallest_voxels", BELOW)],
    "min_static_points": [("static_clusters", "least_points", BELOW)],
    "min_static_length_m": [("static_clusters", "map.shortest_m", BELOW)],
    "max_static_length_m": [("static_clusters", "map.longest_m", ABOVE)],
    "min_static_height_m": [("static_clusters", "map.lowest_m", BELOW)],
    "max_static_height_m": [("static_clusters", "map.highest_m", ABOVE)],
    "min_detected_age_frames": [("detected_objects", "fewest", BELOW)],
    "min_best_half_score": [("detected_objects", "least_score", BELOW)],
    "min_objectness_3d": [("objectness3d", "least_score", BELOW)],
    "min_static_objectness": [("objectness3d", "least_score", BELOW)],
}
"""Rule parameter -> the settings that keep candidates from becoming rows by the same number."""

UNGATED = {
    "also_taken_fit", "also_taken_source", "alignment_method", "egomotion_method",
    "max_cycle_error_m", "max_flat_voxels", "max_height_m", "max_overlapped_share",
    "max_regions", "max_speck_px", "max_static_core_share", "max_static_width_m",
    "min_alignment_share", "min_box_core_share", "min_center_surround_chi2", "min_core_share",
    "min_edge_share", "max_detected_core_share", "min_detected_points", "min_detected_length_m",
    "min_visible_share",
    "min_product", "exceedingly_sure",
    "fewest_modules", "min_motion", "min_sum_of_modules", "min_height_m", "min_range_m",
    "min_box_fill_share", "min_static_age_frames", "min_static_width_m", "min_table_age_frames",
    "min_straightness", "min_straightness_long", "taken_fit", "taken_source",
    "min_match", "min_hidden_passable", "min_rays", "min_stopped_share", "min_witness",
}  # fmt: skip
"""Rule parameters whose column is measured on every candidate, whatever its value."""


def asked() -> list[tuple[str, float]]:
    """Each parameter that has a counterpart, as the rules and every preset set it."""
    texts = {(p.name, p.literal) for rule in load_rules().values() for p in rule.parameters}
    for name in preset_names():
        texts |= set(load_preset(name).fill().parameters.items())
    return sorted((name, float(text)) for name, text in texts if name in COUNTERPARTS)


def test_settings_are_looser_than_the_bounds_of_rules() -> None:
    tighter = []
    for parameter, bound in asked():
        for cue, path, side in COUNTERPARTS[parameter]:
            setting = reduce(getattr, path.split("."), registry.find("evidence", cue).Settings())
            limit = min(setting) if isinstance(setting, tuple) else setting
            if not (limit < bound if side == BELOW else limit > bound):
                tighter.append(f"{cue}.{path} = {setting} hides {parameter} = {bound}")
    assert not tighter


def test_every_parameter_says_whether_a_setting_gates_it() -> None:
    known = {p.name for rule in load_rules().values() for p in rule.parameters}
    assert known <= UNGATED | COUNTERPARTS.keys()
    assert not UNGATED & COUNTERPARTS.keys()
