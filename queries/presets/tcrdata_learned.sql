-- Ours after learning: the tracks of the first round, and what the detector finds standing at one
-- place in many frames, where free space does not contradict. Where both claim a place in a frame,
-- the track wins. What the detector only suspects is left undecided.
-- rules: source, travels, core_share, box_core_share, enough_points, height, range,
--   not_overlapped, near_observation, extended_points, detected_age, detected_share,
--   detected_score, detected_core_share, detected_points, cycle_error, alignment
-- required: source, alignment
-- cues: odometry, tracks, detected_objects
-- ignore: tcrdata_static, detector_faint
-- loosened: min_travel_m = 2, min_age_frames = 3, min_travel_long_m = 1, min_straightness = 0.4,
--   min_straightness_long = 0.5, min_core_share = 0.35, min_box_core_share = 0.2,
--   min_points = 5, min_height_m = 0.3,
--   max_height_m = 5, max_overlapped_share = 0.7, max_frames_from_observation = 15,
--   min_points_extended = 8, max_cycle_error_m = 0.8,
--   min_detected_age_frames = 2, min_visible_share = 0.1, min_best_half_score = 0.1,
--   max_detected_core_share = 0.5, min_detected_points = 1
set variable taken_source = 'track';
set variable taken_fit = 'track';
set variable also_taken_source = 'detected';
set variable also_taken_fit = 'persistent';
set variable egomotion_method = 'odometry';
set variable alignment_method = 'odometry';
-- On fast drives sound odometry leaves up to 0.35 m at the sweep's rim; the votes allow 0.6 m at 40 m.
set variable max_cycle_error_m = 0.5;

with under_a_track as (
    select d.proposal_id
    from proposals d
    join proposals t using (dataset, sequence, frame)
    where d.source = 'detected' and t.source = 'track'
      and abs((d.x_m - t.x_m) * cos(t.yaw_rad) - (d.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((d.x_m - t.x_m) * sin(t.yaw_rad) + (d.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
-- A thing that stands is surer the surer its best detections are, and the more there are.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
anti join under_a_track u on u.proposal_id = p.proposal_id
left join confidences c
    on c.proposal_id = p.proposal_id
    and c.module = case p.source when 'track' then 'track' else 'persistence' end
