-- The boxes that a picture of a frame shows, by kind: the labels of a selection, the labelled objects
-- (truth), and of each region that no label stands on its best supported proposal (rejected).
set variable selection_id = null::varchar;     -- which selection; NULL = every one in the store
set variable pictured_dataset = null::varchar;   -- which dataset; NULL = all
set variable pictured_sequence = null::varchar;  -- which sequence; NULL = all
set variable pictured_frames = null::integer[];  -- which frames; NULL = all
set variable least_points = 10;                -- rejected regions of fewer points are not shown

with shots as (
    select dataset, sequence, frame
    from frames
    where status = 'ok' and round = 1
      and (getvariable('pictured_dataset') is null or dataset = getvariable('pictured_dataset'))
      and (getvariable('pictured_sequence') is null or sequence = getvariable('pictured_sequence'))
      and (getvariable('pictured_frames') is null
           or list_contains(getvariable('pictured_frames'), frame))
),
labelled as (
    select l.* from labels l join shots using (dataset, sequence, frame)
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
regions as (
    select p.* from proposals p join shots using (dataset, sequence, frame)
    where number_of_points >= getvariable('least_points')
    qualify row_number() over (partition by p.dataset, p.sequence, p.frame, region_id
                               order by number_of_points desc, proposal_id) = 1
),
rejected as (
    select r.* from regions r
    where not exists (
        select 1 from labelled l
        where (l.dataset, l.sequence, l.frame) = (r.dataset, r.sequence, r.frame)
          and sqrt(pow(l.x_m - r.x_m, 2) + pow(l.z_m - r.z_m, 2)) < (l.length_m + r.length_m) / 2
    )
    -- Several sources see one object: keep the best supported of those that share a place.
    and not exists (
        select 1 from regions o
        where (o.dataset, o.sequence, o.frame) = (r.dataset, r.sequence, r.frame)
          and sqrt(pow(o.x_m - r.x_m, 2) + pow(o.z_m - r.z_m, 2)) < (o.length_m + r.length_m) / 4
          and (o.number_of_points, o.proposal_id) > (r.number_of_points, r.proposal_id)
    )
)
select dataset, sequence, frame, if(state = 'ignore', 'ignored', 'labels') as kind, proposal_id as id,
       track_id, x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, score, number_of_points
from labelled
union all
select dataset, sequence, frame, 'rejected', proposal_id,
       track_id, x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, null, number_of_points
from rejected
union all
select g.dataset, g.sequence, g.frame, 'truth', object_id,
       object_id, x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, null, null
from ground_truth g join shots using (dataset, sequence, frame)
where category != 'DontCare'
order by all
