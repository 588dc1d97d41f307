-- The released code's first round: components of voxels that move in the image, boxed by a
-- minimum-area rectangle; no center-surround.
-- rules: source, voxels, voxel_sides, image_size, region_rank, cycle_error
-- required: source, voxels, voxel_sides, image_size, region_rank, cycle_error
-- cues: flow_ransac, regions_release
-- ignore: paper
-- next: release_ensemble
-- loosened: min_voxels = 64, max_regions = 24, max_cycle_error_m = 0.25
set variable taken_source = 'release';
set variable taken_fit = 'min_area';
set variable max_cycle_error_m = 0.1;
set variable egomotion_method = 'flow_ransac';

-- The released code does not rank its labels; here the faster in the image, the surer.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'motion_2d'
