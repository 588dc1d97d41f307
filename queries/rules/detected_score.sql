-- In its best frames the detector is sure of it. Abstains on everything else.
-- source: ours: far and hidden objects are faint for most of a drive, and sure when near
-- needs: value >= min_best_half_score
-- cues: detected_objects
set variable min_best_half_score = 0.5;  -- probability: mean over the surer half of its detections

select p.proposal_id, p.best_half_score as value,
       getvariable('min_best_half_score')::double as bound,
       case when p.source = 'detected' then value >= bound end as passed
from proposals p
