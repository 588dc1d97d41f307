-- Our default: tracks of what free space shows to have moved, refined over the whole track and filled
-- where they were hidden.
-- rules: source, travels, core_share, height, near_observation, enough_points, range,
--   cycle_error, alignment
-- required: source, travels, core_share
-- cues: odometry, tracks
set variable taken_source = 'track';
set variable taken_fit = 'track';
set variable egomotion_method = 'odometry';
set variable score_travel_m = 3.0;  -- m: a track that goes this far has 0.63 of the highest score
set variable score_decay_frames = 10;  -- frames: a filled box this far from a sighting keeps 0.37

-- A track is surer the farther it goes and the more of it stands where others saw through.
select p.proposal_id, 'positive' as state,
       (1 - exp(-p.travel_m / (getvariable('score_travel_m') * p.metric_scale)))
       * p.track_core_share
       * exp(-coalesce(p.frames_from_observation, 0) / getvariable('score_decay_frames')) as score
from proposals p
