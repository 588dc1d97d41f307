-- The detector found it in a fair share of the frames that show its place. Abstains on everything
-- else.
-- source: ours: what is there only now and then is a mistake of the detector
-- needs: value >= min_visible_share
-- cues: detected_objects
set variable min_visible_share = 0.25;  -- share: of the frames in which its place could be seen

select p.proposal_id, p.visible_share as value,
       getvariable('min_visible_share')::double as bound,
       case when p.source = 'detected' then value >= bound end as passed
from proposals p
