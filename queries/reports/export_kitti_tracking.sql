-- The rows of KITTI's tracking results: the positive labels of a selection with their camera.
-- track numbers count from 0 in each sequence; a label without a track, and the less sure one of two
-- labels of a track in a frame, gets a number of its own. truncated is 0 to 2, occluded 0 to 3
-- (3 = unknown), as KITTI's tracking labels have them.
set variable selection_id = null::varchar;     -- which selection; NULL = every one in the store
set variable exported_dataset = null::varchar;  -- which dataset; NULL = all
set variable exported_state = 'positive';      -- labels of this state are written
set variable partly_truncated_share = 0.15;    -- share of the 2D box outside the image: truncated 1
set variable largely_truncated_share = 0.5;    -- share of the 2D box outside the image: truncated 2
set variable partly_occluded_share = 0.1;      -- share of the outline behind others: occluded 1
set variable largely_occluded_share = 0.5;     -- share of the outline behind others: occluded 2

with chosen as (
    select *, row_number() over (partition by dataset, sequence, frame, track_id
                                 order by score desc, proposal_id) as place
    from labels
    where (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
      and (getvariable('exported_dataset') is null or dataset = getvariable('exported_dataset'))
      and state = getvariable('exported_state')
),
named as (
    select *, track_id is not null and place = 1 as on_track,
           if(on_track, track_id, proposal_id) as number_key
    from chosen
)
select l.dataset, l.sequence, l.frame, l.proposal_id,
       dense_rank() over (partition by l.dataset, l.sequence
                          order by l.on_track desc, l.number_key) - 1 as track_number,
       case when truncated_share >= getvariable('largely_truncated_share') then 2
            when truncated_share >= getvariable('partly_truncated_share') then 1
            else 0 end as truncated,
       case when occluded_share is null then 3
            when occluded_share >= getvariable('largely_occluded_share') then 2
            when occluded_share >= getvariable('partly_occluded_share') then 1
            else 0 end as occluded,
       left_px, top_px, right_px, bottom_px,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, score,
       f.width_px, f.height_px, f.projection, f.camera_T_level
from named l
left join frames f on (f.dataset, f.sequence, f.frame, f.round) = (l.dataset, l.sequence, l.frame, 1)
order by l.dataset, l.sequence, l.frame, score desc, l.proposal_id
