-- A thing that never moved shows in several frames. Abstains on everything else.
-- source: ours
-- needs: value >= min_static_age_frames
-- cues: static_clusters
set variable min_static_age_frames = 4;  -- frames: in which it shows points

select p.proposal_id, p.age_frames::double as value,
       getvariable('min_static_age_frames')::double as bound,
       case when p.source = 'static' then value >= bound end as passed
from proposals p
