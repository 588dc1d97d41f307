-- The box rests on enough points. A box filled in between two sightings needs fewer than one added
-- beyond the first or the last, because both sides hold it.
-- source: ours
-- needs: value >= min_points_observed, min_points_gap or min_points_extended, as it was found
-- cues:
set variable min_points_observed = 8;  -- points: of the region
set variable min_points_gap = 1;  -- points: inside a box between two sightings
set variable min_points_extended = 12;  -- points: inside a box beyond the first or last sighting

select p.proposal_id, p.number_of_points::double as value, b.bound,
       p.number_of_points >= b.bound as passed
from proposals p,
lateral (select case p.found when 'observed' then getvariable('min_points_observed')
                             when 'gap' then getvariable('min_points_gap')
                             else getvariable('min_points_extended') end::double as bound) b
