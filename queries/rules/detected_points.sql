-- A detected thing shows some points in the frame. Abstains on everything else.
-- source: ours: a place without points is a guess
-- needs: value >= min_detected_points
-- cues: detected_objects
set variable min_detected_points = 5;  -- points: in the box, ground aside

select p.proposal_id, p.number_of_points::double as value,
       getvariable('min_detected_points')::double as bound,
       case when p.source = 'detected' then value >= bound end as passed
from proposals p
