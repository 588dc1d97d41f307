-- The detector is sure enough that an object has its centre here. Abstains outside of the ground
-- that it covers.
-- source: section 3.6, the module's confidence
-- needs: value >= min_objectness_3d
-- cues: objectness3d
set variable min_objectness_3d = 0.1;  -- probability: of a centre in the footprint

select p.proposal_id, c.confidence as value, getvariable('min_objectness_3d')::double as bound,
       value >= bound as passed
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'objectness_3d'
