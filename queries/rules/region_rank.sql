-- The region is among the largest of its frame.
-- source: released code: at most 16 regions a frame
-- needs: value <= max_regions
-- cues: regions_release
set variable max_regions = 16;  -- regions: kept a frame, largest first

select p.proposal_id, p.size_rank::double as value, getvariable('max_regions')::double as bound,
       value <= bound as passed
from proposals p
