-- Ours after learning, and the boxes that tracking adds where none of its labels is: what the
-- templates and the library of trajectories follow. Boxes filled in out of sight are marked as gaps.
-- rules: source, travels, core_share, box_core_share, enough_points, height, range,
--   not_overlapped, near_observation, extended_points, static_length, static_width, static_height,
--   static_edge_share, static_points, static_age, static_core_share, static_objectness,
--   detected_age, detected_share, detected_score, detected_length, detected_core_share,
--   detected_points, followed, cycle_error, alignment
-- required: source, alignment
-- cues: odometry, tracks, static_clusters, objectness3d, detected_objects
-- ignore: tcrdata_static, detector_faint
-- follows: tcrdata_learned
-- loosened: min_travel_m = 2, min_age_frames = 3, min_travel_long_m = 1, min_straightness = 0.4,
--   min_straightness_long = 0.5, min_core_share = 0.35, min_box_core_share = 0.2,
--   min_points = 5, min_height_m = 0.3,
--   max_height_m = 5, max_overlapped_share = 0.7, max_frames_from_observation = 15,
--   min_points_extended = 8, max_cycle_error_m = 0.8,
--   min_static_length_m = 2.2, max_static_length_m = 7, min_static_width_m = 0.8,
--   max_static_width_m = 2.6, min_static_height_m = 1.0, max_static_height_m = 3,
--   min_edge_share = 0.35, min_static_points = 6, min_static_age_frames = 3,
--   max_static_core_share = 0.2, min_static_objectness = 0.05,
--   min_detected_age_frames = 2, min_visible_share = 0.1, min_best_half_score = 0.1,
--   min_detected_length_m = 0.3, max_detected_core_share = 0.5, min_detected_points = 1,
--   min_match = 0.3
set variable taken_source = 'track';
set variable taken_fit = 'track';
set variable also_taken_source = 'static,detected,tracklet';
set variable also_taken_fit = 'l_shape,persistent,tracklet';
set variable egomotion_method = 'odometry';
set variable alignment_method = 'odometry';
-- On fast drives sound odometry leaves up to 0.35 m at the sweep's rim; the votes allow 0.6 m at 40 m.
set variable max_cycle_error_m = 0.5;

-- A thing that stands is surer the more of its points lie along its sides, or the surer its best
-- detections are and the more there are; one that was followed, the better it matches.
with ranked as (
    select p.*, coalesce(c.confidence, 0)::double as score,
           list_position(['track', 'static', 'detected', 'tracklet'], p.source) as place
    from proposals p
    left join confidences c
        on c.proposal_id = p.proposal_id
        and c.module = case p.source when 'track' then 'track' when 'static' then 'shape'
                                     when 'tracklet' then 'tracklet' else 'persistence' end
),
under_another as (
    select d.proposal_id
    from ranked d
    join ranked t using (dataset, sequence, frame)
    where d.place > 1 and (t.place, -t.score, t.proposal_id) < (d.place, -d.score, d.proposal_id)
      and ((abs((d.x_m - t.x_m) * cos(t.yaw_rad) - (d.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
            and abs((d.x_m - t.x_m) * sin(t.yaw_rad) + (d.z_m - t.z_m) * cos(t.yaw_rad))
                <= t.width_m / 2)
           or (t.place > 1
               and abs((d.x_m - t.x_m) * cos(d.yaw_rad) - (d.z_m - t.z_m) * sin(d.yaw_rad))
                   <= d.length_m / 2
               and abs((d.x_m - t.x_m) * sin(d.yaw_rad) + (d.z_m - t.z_m) * cos(d.yaw_rad))
                   <= d.width_m / 2))
)
select r.proposal_id, 'positive' as state, r.score
from ranked r
anti join under_another u on u.proposal_id = r.proposal_id
