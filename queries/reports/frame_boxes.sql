-- The boxes to draw in one frame of one selection: its labels, the proposals that one rule alone
-- rejected, and the ground truth where there is any.
set variable drawn_selection = null::varchar;  -- id of the selection
set variable drawn_dataset = 'kitti';          -- dataset of the frame
set variable drawn_sequence = '';              -- drive or clip
set variable drawn_frame = 0;                  -- number of the frame
set variable drawn_truth = true;               -- draw ground truth

with here as (
    select proposal_id, x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad
    from proposals
    where (dataset, sequence) = (getvariable('drawn_dataset'), getvariable('drawn_sequence'))
      and frame = getvariable('drawn_frame')
),
chosen as (
    select *
    from labels
    where selection_id = getvariable('drawn_selection')
      and (dataset, sequence) = (getvariable('drawn_dataset'), getvariable('drawn_sequence'))
      and frame = getvariable('drawn_frame')
),
verdicts as (
    select proposal_id,
           count(*) filter (passed = false) as failed,
           bool_or(passed = false) filter (rule = 'source') as foreign_source
    from checks
    where selection_id = getvariable('drawn_selection')
      and proposal_id in (select proposal_id from here)
    group by proposal_id
)
select if(state = 'positive', 'labels', 'ignored') as kind,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad
from chosen
union all
select 'rejected', h.* exclude (proposal_id)
from here h
join verdicts v using (proposal_id)
where v.failed = 1 and not coalesce(v.foreign_source, false)
union all
select 'truth', x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad
from ground_truth
where (dataset, sequence) = (getvariable('drawn_dataset'), getvariable('drawn_sequence'))
  and frame = getvariable('drawn_frame') and x_m is not null and getvariable('drawn_truth')
order by all
