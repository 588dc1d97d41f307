-- Much of what the object's box holds was not there in other sweeps, and not just the cluster that
-- the box was fitted to: a sliver of a wall, or of a parked car that is passed closely, is no
-- object. Abstains on what is no track.
-- source: ours: what moved has 0.44 and more on two real clips; slivers of what stands up to 0.30
-- needs: value >= min_box_core_share
-- cues: tracks
set variable min_box_core_share = 0.35;  -- share: of the points in the box; median over the track

select p.proposal_id, p.track_box_core_share as value,
       getvariable('min_box_core_share')::double as bound,
       case when p.source = 'track' then value >= bound end as passed
from proposals p
