-- The paper's first round: regions of stabilised 3D motion, boxed by a minimum-area rectangle, kept
-- when the egomotion checks and the motion inside differs from the motion around.
-- rules: source, motion_level, enough_points, center_surround, cycle_error
-- required: source, motion_level, center_surround, cycle_error
-- cues: flow_ransac, regions_paper
set variable taken_source = 'paper';
set variable taken_fit = 'min_area';
set variable max_cycle_error_m = 0.25;
set variable egomotion_method = 'flow_ransac';

-- The chi-square distance lies in [0, 1] and says how surely the region moves by itself.
select p.proposal_id, 'positive' as state, p.center_surround_chi2 as score
from proposals p
