-- Much of the object stands where other sweeps saw through: it is here now and was not there then.
-- For a track, the median over its frames. Abstains on what stands still.
-- source: ours: at least half of a cluster's points are core points
-- needs: value >= min_core_share
-- cues: regions_free_space, tracks
set variable min_core_share = 0.5;  -- share: points seen through by >= 2 sweeps, more than saw them

select p.proposal_id, coalesce(p.track_core_share, p.core_share) as value,
       getvariable('min_core_share')::double as bound,
       case when p.source not in ('static', 'detected') then value >= bound end as passed
from proposals p
