-- Ours after learning: the tracks of the first round, and what the detector sees standing still in
-- many frames at one place. Where both have a place, the track wins.
-- rules: source, travels, core_share, box_core_share, enough_points, height, range, not_overlapped,
--   near_observation, extended_points, cycle_error, alignment
-- required: source, alignment
-- cues: odometry, tracks, objectness3d
-- ignore: tcrdata_static
set variable taken_source = 'track';
set variable taken_fit = 'track';
set variable egomotion_method = 'odometry';
set variable alignment_method = 'odometry';
set variable max_cycle_error_m = 0.5;

select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'track'
