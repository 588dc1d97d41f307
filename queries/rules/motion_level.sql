-- Of the levels at which regions of stabilised 3D motion were cut out, the preset takes one: the
-- highest at or below what is asked for. Below the lowest there is none, and nothing passes; another
-- level is cut by `tcrdata build --set regions_paper.levels_m=...`.
-- source: section 3.7: threshold |dXYZ|, then connected components; the paper gives no number
-- needs: value <= motion_level_m, and no higher level of the build is
-- cues: regions_paper
set variable motion_level_m = 0.4;  -- m: the lowest level above RANSAC's inlier radius of 0.25 m

select p.proposal_id, p.motion_threshold_m as value, getvariable('motion_level_m')::double as bound,
       value <= bound and coalesce(p.motion_threshold_next_m > bound, true) as passed
from proposals p
