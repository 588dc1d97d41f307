-- No other sweep saw through a thing that never moved: what arrives, leaves or passes is not
-- parked.
-- Abstains on everything else.
-- source: ours: parked cars have 0.00, one that had been driving 0.45
-- needs: value <= max_static_core_share
-- cues: static_clusters
set variable max_static_core_share = 0.1;  -- share: of the points, seen through; median over frames

select p.proposal_id, p.track_core_share as value,
       getvariable('max_static_core_share')::double as bound,
       case when p.source = 'static' then value <= bound end as passed
from proposals p
