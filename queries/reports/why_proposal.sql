-- One proposal as people meet it: where it is, what it rests on, and the label that a selection made
-- of it (NULL where it made none).
set variable selection_id = null::varchar;  -- which selection's labels; NULL = every one in the store
set variable proposal_id = null::varchar;   -- which proposal; NULL = all

select p.proposal_id, p.dataset, p.sequence, p.frame, p.round, p.source, p.fit, p.found, p.region_id,
       p.track_id, p.metric_scale, p.x_m, p.y_m, p.z_m, p.length_m, p.width_m, p.height_m, p.yaw_rad,
       p.left_px, p.top_px, p.right_px, p.bottom_px, p.range_m, p.number_of_points, p.point_indices,
       l.selection_id, l.state, l.ignored_because, l.score, l.carried_by
from proposals p
left join labels l
    on l.proposal_id = p.proposal_id and l.dataset = p.dataset and l.sequence = p.sequence
    and (getvariable('selection_id') is null or l.selection_id = getvariable('selection_id'))
where getvariable('proposal_id') is null or p.proposal_id = getvariable('proposal_id')
order by p.dataset, p.sequence, p.frame, p.proposal_id, l.selection_id
