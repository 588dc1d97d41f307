-- The detector suspects an object where a thing of a vehicle's shape stands. Abstains on everything
-- else, and where no detector speaks.
-- source: section 3.6: independent modules agree; ours: its shape is one, its look another
-- needs: value >= min_static_objectness
-- cues: static_clusters, objectness3d
set variable min_static_objectness = 0.1;  -- probability: of a centre in the footprint

select p.proposal_id, c.confidence as value,
       getvariable('min_static_objectness')::double as bound,
       case when p.source = 'static' then value >= bound end as passed
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'objectness_3d'
