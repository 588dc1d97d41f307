-- The component is no sheet: each of its sides is longer than this many voxels.
-- source: released code: all sides > 1 voxel
-- needs: value > max_flat_voxels
-- cues: regions_release
set variable max_flat_voxels = 1;  -- voxels: a side up to this counts as flat

select p.proposal_id, p.smallest_side_voxels::double as value,
       getvariable('max_flat_voxels')::double as bound,
       value > bound as passed
from proposals p
