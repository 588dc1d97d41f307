-- The proposals of a frame that lie nearest to a point on the ground, level frame: first those that
-- the selection's rule `source` judges and that are within reach, then all others. distance_m is to
-- the box seen from above, 0 inside it; among boxes that hold the point the nearer centre is first.
set variable selection_id = null::varchar;    -- which selection; NULL = every one in the store
set variable asked_dataset = null::varchar;   -- which dataset; NULL = all
set variable asked_sequence = null::varchar;  -- which sequence; NULL = all
set variable asked_frame = 0;                 -- which frame
set variable asked_x_m = 0.0;                 -- m: to the right of the sensor
set variable asked_z_m = 10.0;                -- m: ahead of the sensor
set variable reach_m = 1.5;                   -- m * metric_scale: judged ones so near go first
set variable shown = 5;                       -- how many

with judged as (
    select proposal_id, bool_or(passed) as passed
    from checks
    where rule = 'source'
      and (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
    group by proposal_id
),
turned as (
    select p.*, coalesce(j.passed, true) as judged,
           getvariable('asked_x_m') - p.x_m as dx, getvariable('asked_z_m') - p.z_m as dz,
           abs(dx * cos(p.yaw_rad) - dz * sin(p.yaw_rad)) - p.length_m / 2 as beyond_length,
           abs(dx * sin(p.yaw_rad) + dz * cos(p.yaw_rad)) - p.width_m / 2 as beyond_width
    from proposals p
    left join judged j on j.proposal_id = p.proposal_id
    where p.frame = getvariable('asked_frame')
      and (getvariable('asked_dataset') is null or p.dataset = getvariable('asked_dataset'))
      and (getvariable('asked_sequence') is null or p.sequence = getvariable('asked_sequence'))
)
select proposal_id, source, fit, judged,
       sqrt(pow(greatest(beyond_length, 0), 2) + pow(greatest(beyond_width, 0), 2)) as distance_m,
       sqrt(dx * dx + dz * dz) as center_distance_m
from turned
order by judged and distance_m <= getvariable('reach_m') * metric_scale desc,
         distance_m, center_distance_m, proposal_id
limit getvariable('shown')
