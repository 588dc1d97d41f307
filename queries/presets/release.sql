-- The released code's first round: components of voxels that move in the image, boxed by a
-- minimum-area rectangle; no center-surround.
-- rules: source, voxels, voxel_sides, image_size, region_rank, cycle_error
-- required: source, voxels, voxel_sides, image_size, region_rank, cycle_error
-- cues: flow_ransac, regions_release
set variable taken_source = 'release';
set variable taken_fit = 'min_area';
set variable max_cycle_error_m = 0.1;
set variable egomotion_method = 'flow_ransac';
set variable full_score_voxels = 1024;  -- voxels: from here on a region has the highest score

-- The released code does not rank its labels: larger regions first.
select p.proposal_id, 'positive' as state,
       least(1, least(p.voxels_a, p.voxels_b) / getvariable('full_score_voxels'))::double as score
from proposals p
