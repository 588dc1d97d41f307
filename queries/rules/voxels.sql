-- The component is large enough in both of the release's motion tests: direction (A) and size (B).
-- source: released code: at least 128 voxels of 0.125 m of A and of B
-- needs: value >= min_voxels
-- cues: regions_release
set variable min_voxels = 128;  -- voxels: of the smaller of A and B

select p.proposal_id, least(p.voxels_a, p.voxels_b)::double as value,
       getvariable('min_voxels')::double as bound,
       least(p.voxels_a, p.voxels_b) >= getvariable('min_voxels') as passed
from proposals p
