-- The region was cut out at this level of egomotion-stabilised 3D motion, or above it.
-- source: section 3.7: threshold |dXYZ|, then connected components
-- needs: value >= min_motion_level_m * metric_scale
-- cues: regions_paper
set variable min_motion_level_m = 0.2;  -- m: |dXYZ| between two frames; the paper gives no number

select p.proposal_id, p.motion_threshold_m as value,
       (getvariable('min_motion_level_m') * p.metric_scale)::double as bound,
       p.motion_threshold_m >= getvariable('min_motion_level_m') * p.metric_scale as passed
from proposals p
