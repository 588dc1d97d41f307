-- The other labels of a proposal's frame: what a picture of the proposal shows around it.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable proposal_id = null::varchar;   -- around which proposal; NULL = any

select l.selection_id, l.proposal_id, l.state, l.x_m, l.y_m, l.z_m, l.length_m, l.width_m,
       l.height_m, l.yaw_rad
from labels l
join proposals p
    on p.dataset = l.dataset and p.sequence = l.sequence and p.frame = l.frame
    and p.round = l.round and p.proposal_id <> l.proposal_id
where (getvariable('selection_id') is null or l.selection_id = getvariable('selection_id'))
  and (getvariable('proposal_id') is null or p.proposal_id = getvariable('proposal_id'))
group by all
order by all
