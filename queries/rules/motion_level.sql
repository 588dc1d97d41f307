-- Of the levels at which regions of stabilised 3D motion were cut out, the preset takes one.
-- source: section 3.7: threshold |dXYZ|, then connected components; the paper gives no number
-- needs: value = motion_level_m
-- cues: regions_paper
set variable motion_level_m = 0.4;  -- m: the lowest level above RANSAC's inlier radius of 0.25 m

select p.proposal_id, p.motion_threshold_m as value, getvariable('motion_level_m')::double as bound,
       abs(value - bound) < 1e-9 as passed
from proposals p
