-- What else stands in the frames of some proposals: the labels of a selection and the labelled
-- objects (truth), for the pictures beside them. No rule reads this.
set variable selection_id = null::varchar;       -- which selection; NULL = every one in the store
set variable shown_proposals = null::varchar[];  -- ids: whose frames; NULL = all

with shots as (
    select distinct dataset, sequence, frame
    from proposals
    where getvariable('shown_proposals') is null
       or list_contains(getvariable('shown_proposals'), proposal_id)
)
select dataset, sequence, frame, if(state = 'ignore', 'ignored', 'labels') as kind,
       proposal_id as object_id, null as category,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad
from labels
join shots using (dataset, sequence, frame)
where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
union all
select dataset, sequence, frame, 'truth', object_id, category,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad
from ground_truth
join shots using (dataset, sequence, frame)
where category != 'DontCare'
order by all
