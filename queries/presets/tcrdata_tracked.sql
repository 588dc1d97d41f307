-- Our default, and the boxes that tracking adds: what the templates and the library of trajectories
-- follow where a label's own track has no box. It takes `tcrdata track` before; without, it is our
-- default. Boxes filled in out of sight are marked as gaps.
-- rules: source, travels, core_share, box_core_share, enough_points, height, range,
--   not_overlapped, near_observation, extended_points, followed, cycle_error, alignment
-- required: source, alignment
-- cues: odometry, tracks
-- ignore: tcrdata_static
-- follows: tcrdata
-- next: tcrdata_learned
-- loosened: min_travel_m = 2, min_age_frames = 3, min_travel_long_m = 1, min_straightness = 0.4,
--   min_straightness_long = 0.5, min_core_share = 0.35, min_box_core_share = 0.2,
--   min_points = 5, min_height_m = 0.3,
--   max_height_m = 5, max_overlapped_share = 0.7, max_frames_from_observation = 8,
--   min_points_extended = 8, min_match = 0.3
set variable taken_source = 'track';
set variable taken_fit = 'track';
set variable also_taken_source = 'tracklet';
set variable also_taken_fit = 'tracklet';
set variable egomotion_method = 'odometry';
set variable alignment_method = 'odometry';
-- On fast drives sound odometry leaves up to 0.35 m at the sweep's rim; the votes allow 0.6 m at 40 m.
set variable max_cycle_error_m = 0.5;

with on_a_track as (
    select f.proposal_id
    from proposals f
    join proposals t using (dataset, sequence, frame)
    where f.source = 'tracklet' and t.source = 'track'
      and abs((f.x_m - t.x_m) * cos(t.yaw_rad) - (f.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((f.x_m - t.x_m) * sin(t.yaw_rad) + (f.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
-- A box is as sure as its track; one that was followed, as its match.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
anti join on_a_track o on o.proposal_id = p.proposal_id
left join confidences c
    on c.proposal_id = p.proposal_id
    and c.module = case p.source when 'track' then 'track' else 'tracklet' end
