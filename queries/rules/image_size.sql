-- The region is not a speck in the image.
-- source: released code: > 4 projected px
-- needs: value > max_speck_px
-- cues: regions_release
set variable max_speck_px = 4;  -- px: up to so many pixels the region counts as a speck

select p.proposal_id, p.projected_px::double as value, getvariable('max_speck_px')::double as bound,
       value > bound as passed
from proposals p
