-- A box put beyond the first or the last sighting of its track holds points. Abstains on what was
-- seen, and between two sightings, where both sides hold the box.
-- source: ours: a constant turn rate is believed no further than the sensor confirms it
-- needs: value >= min_points_extended
-- cues: tracks
set variable min_points_extended = 12;  -- points: inside the box

select p.proposal_id, p.number_of_points::double as value,
       getvariable('min_points_extended')::double as bound,
       case when p.found = 'extended' then value >= bound end as passed
from proposals p
