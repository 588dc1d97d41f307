-- Our default, and things of a vehicle's shape that never moved while the clip ran. Where the
-- centre of such a thing lies in the box of a track in the same frame, the track wins.
-- rules: source, travels, core_share, box_core_share, enough_points, height, range,
--   not_overlapped, near_observation, extended_points, static_length, static_width, static_height,
--   static_edge_share, static_points, static_age, static_core_share, cycle_error, alignment
-- required: source, alignment
-- cues: odometry, tracks, static_clusters
-- next: tcrdata_learned
-- loosened: min_travel_m = 2, min_age_frames = 3, min_travel_long_m = 1, min_straightness = 0.4,
--   min_straightness_long = 0.5, min_core_share = 0.35, min_box_core_share = 0.2,
--   min_points = 5, min_height_m = 0.3,
--   max_height_m = 5, max_overlapped_share = 0.7, max_frames_from_observation = 8,
--   min_points_extended = 8,
--   min_static_length_m = 2.2, max_static_length_m = 7, min_static_width_m = 0.8,
--   max_static_width_m = 2.6, min_static_height_m = 1.0, max_static_height_m = 3,
--   min_edge_share = 0.35, min_static_points = 6, min_static_age_frames = 3,
--   max_static_core_share = 0.2
set variable taken_source = 'track';
set variable taken_fit = 'track';
set variable also_taken_source = 'static';
set variable also_taken_fit = 'l_shape';
set variable egomotion_method = 'odometry';
set variable alignment_method = 'odometry';
-- On fast drives sound odometry leaves up to 0.35 m at the sweep's rim; the votes allow 0.6 m at 40 m.
set variable max_cycle_error_m = 0.5;

with under_a_track as (
    select s.proposal_id
    from proposals s
    join proposals t using (dataset, sequence, frame)
    where s.source = 'static' and t.source = 'track'
      and abs((s.x_m - t.x_m) * cos(t.yaw_rad) - (s.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((s.x_m - t.x_m) * sin(t.yaw_rad) + (s.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
-- A static thing is surer the more of its points lie along the sides of its box.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
anti join under_a_track u on u.proposal_id = p.proposal_id
left join confidences c
    on c.proposal_id = p.proposal_id
    and c.module = case p.source when 'track' then 'track' else 'shape' end
