-- Something is there: of the rays that reach the box, enough end in it. Abstains where too few do.
-- source: the released code: what is labelled is occupied and no free space
-- needs: value >= min_stopped_share
-- cues: visibility
set variable min_stopped_share = 0.3;  -- share: of the rays that reach the box, those that end in it
set variable min_rays = 10;  -- rays: with fewer it abstains

select p.proposal_id, c.confidence as value, getvariable('min_stopped_share')::double as bound,
       case when c.raw_value >= getvariable('min_rays') then value >= bound end as passed
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'visibility'
