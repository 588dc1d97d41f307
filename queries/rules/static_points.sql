-- Enough of a thing that never moved is seen in this very frame. Abstains on everything else.
-- source: ours
-- needs: value >= min_static_points
-- cues: static_clusters
set variable min_static_points = 12;  -- points: inside the box in this frame

select p.proposal_id, p.number_of_points::double as value,
       getvariable('min_static_points')::double as bound,
       case when p.source = 'static' then value >= bound end as passed
from proposals p
