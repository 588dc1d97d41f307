-- The box rests on enough points of the region it was fitted to. Abstains on filled-in boxes.
-- source: ours; the paper names no number
-- needs: value >= min_points
-- cues:
set variable min_points = 8;  -- points: of the region

select p.proposal_id, p.number_of_points::double as value,
       getvariable('min_points')::double as bound,
       case when p.found = 'observed' then value >= bound end as passed
from proposals p
