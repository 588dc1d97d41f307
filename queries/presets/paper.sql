-- The paper's first round: regions of stabilised 3D motion, boxed by a minimum-area rectangle, kept
-- when the egomotion checks and the motion inside differs from the motion around.
-- rules: source, motion_level, enough_points, center_surround, cycle_error
-- required: source, motion_level, center_surround, cycle_error
-- cues: flow_ransac, regions_paper
set variable taken_source = 'paper';
set variable taken_fit = 'min_area';
set variable min_points = 10;
set variable max_cycle_error_m = 0.25;
set variable egomotion_method = 'flow_ransac';

-- The faster a region moves by itself, the surer.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'motion_3d'
