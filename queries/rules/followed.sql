-- A box of a tracklet matches what the frame shows, or lies where it could not be seen. Abstains on
-- all other boxes.
-- source: section 3.5
-- needs: value >= min_match, or min_hidden_passable out of sight
-- cues:
set variable min_match = 0.5;             -- score: of the nearest box or the correlation
set variable min_hidden_passable = 0.99;  -- share: mean p along the path out of sight

select p.proposal_id, c.confidence as value,
       case when p.found = 'observed' then getvariable('min_match')
            else getvariable('min_hidden_passable') end::double as bound,
       value >= bound as passed
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'tracklet'
