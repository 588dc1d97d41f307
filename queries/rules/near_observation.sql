-- A box that was filled in lies near a frame in which the object was seen.
-- source: ours: the ends are extended by at most 5 frames
-- needs: value <= max_frames_from_observation
-- cues: tracks, static_clusters
set variable max_frames_from_observation = 5;  -- frames: to the nearest sighting

select p.proposal_id, p.frames_from_observation::double as value,
       getvariable('max_frames_from_observation')::double as bound,
       value <= bound as passed
from proposals p
