-- The paper's first round: regions of stabilised 3D motion, boxed by a minimum-area rectangle, kept
-- when the egomotion checks and the motion inside differs from the motion around.
-- rules: source, motion_level, enough_points, center_surround, cycle_error
-- required: source, motion_level, center_surround, cycle_error
-- cues: flow_ransac, regions_paper
-- ignore: release
-- next: paper_ensemble
-- loosened: min_points = 6, min_center_surround_chi2 = 0.35, max_cycle_error_m = 0.35
set variable taken_source = 'paper';
set variable taken_fit = 'min_area';
set variable min_points = 10;
set variable max_cycle_error_m = 0.25;
-- Its RANSAC takes the flows that pass the released code's cycle test, one to one. With the paper's
-- own (tcrdata build --set flow_ransac.cycle_test=paper) sweeps align worse on two real clips (0.55
-- of the points instead of 0.60), and recall falls by 0.01 at IoU 0.3.
set variable egomotion_method = 'flow_ransac';

-- The faster a region moves by itself, the surer.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'motion_3d'
