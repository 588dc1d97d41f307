-- The detector found it in several frames at one place. Abstains on everything else.
-- source: ours: what stands is seen again
-- needs: value >= min_detected_age_frames
-- cues: detected_objects
set variable min_detected_age_frames = 4;  -- frames: in which it was detected

select p.proposal_id, p.age_frames::double as value,
       getvariable('min_detected_age_frames')::double as bound,
       case when p.source = 'detected' then value >= bound end as passed
from proposals p
