-- The component is large enough in the release's two motion tests together: the flow has another
-- direction (A) and another size (B) than the egomotion would give.
-- source: released code: at least 128 voxels of 0.125 m
-- needs: value >= min_voxels
-- cues: regions_release
set variable min_voxels = 128;  -- voxels: of both A and B

select p.proposal_id, p.voxels_a::double as value, getvariable('min_voxels')::double as bound,
       value >= bound as passed
from proposals p
