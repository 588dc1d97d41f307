-- The points of a thing that never moved lie along the sides of its box, as a car's do; those of a
-- hedge fill it. Abstains on everything else.
-- source: ours: at least half of the points within 0.3 m of the box's edges
-- needs: value >= min_edge_share
-- cues: static_clusters
set variable min_edge_share = 0.5;  -- share: of the points, near a side seen from above

select p.proposal_id, p.edge_share as value, getvariable('min_edge_share')::double as bound,
       case when p.source = 'static' then value >= bound end as passed
from proposals p
