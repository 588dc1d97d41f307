-- Our default: tracks of what free space shows to have moved, refined over the whole track and
-- filled in where they were hidden.
-- rules: source, travels, core_share, box_core_share, enough_points, height, range,
--   not_overlapped, near_observation, extended_points, cycle_error, alignment
-- required: source, alignment
-- cues: odometry, tracks
-- ignore: tcrdata_static
-- next: tcrdata_learned
-- loosened: min_travel_m = 2, min_age_frames = 3, min_travel_long_m = 1, min_straightness = 0.4,
--   min_straightness_long = 0.5, min_core_share = 0.35, min_box_core_share = 0.2,
--   min_points = 5, min_height_m = 0.3,
--   max_height_m = 5, max_overlapped_share = 0.7, max_frames_from_observation = 8,
--   min_points_extended = 8
set variable taken_source = 'track';
set variable taken_fit = 'track';
set variable egomotion_method = 'odometry';
set variable alignment_method = 'odometry';
-- On fast drives sound odometry leaves up to 0.35 m at the sweep's rim; the votes allow 0.6 m at 40 m.
set variable max_cycle_error_m = 0.5;

-- A track is surer the longer it was seen and the farther and straighter it goes.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'track'
