-- The region is not a speck in the image.
-- source: released code: > 4 projected px
-- needs: value > max_speck_px
-- cues: regions_release
set variable max_speck_px = 4;  -- px: a smaller side up to this counts as a speck

select p.proposal_id, p.smallest_side_px as value, getvariable('max_speck_px')::double as bound,
       p.smallest_side_px > getvariable('max_speck_px') as passed
from proposals p
