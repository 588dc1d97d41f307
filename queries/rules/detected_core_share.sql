-- Few other sweeps saw through a detected thing that stands: free space does not contradict.
-- Abstains on everything else.
-- source: ours: the detector and free space are two witnesses
-- needs: value <= max_detected_core_share
-- cues: detected_objects
set variable max_detected_core_share = 0.3;  -- share: of the points, seen through; median over frames

select p.proposal_id, p.track_core_share as value,
       getvariable('max_detected_core_share')::double as bound,
       case when p.source = 'detected' then value <= bound end as passed
from proposals p
