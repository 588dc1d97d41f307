-- What a trained detector at least suspects: too little for a label, too much for background.
-- rules: source, objectness_3d
-- required: source, objectness_3d
-- cues: objectness3d
set variable taken_source = 'detector';
set variable taken_fit = 'center_net';
set variable min_objectness_3d = 0.15;

select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'objectness_3d'
