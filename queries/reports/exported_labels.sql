-- The labels that an export writes, in the order of sequences and frames: positive ones, and those left undecided (ignore) when they are kept.
-- track_number counts from 0 in each sequence, positive labels alone; a label without a track, and the
-- less sure one of two labels of a track in a frame, gets a number of its own. truncation is 0 to 2,
-- occlusion 0 to 3 (3 = unknown) and difficulty 0 to 2 (easy, moderate, hard; -1 = none of them), as
-- KITTI has them.
set variable selection_id = null::varchar;     -- which selection; NULL = every one in the store
set variable exported_dataset = null::varchar;  -- which dataset; NULL = all
set variable first_sequence = null::varchar;   -- name of the first sequence, as text sorts; NULL = from the beginning
set variable last_sequence = null::varchar;    -- name of the last one; NULL = to the end
set variable keep_ignored = true;              -- true or false: undecided labels are written too
set variable partly_truncated_share = 0.15;    -- share of the 2D box outside the image: truncation 1
set variable largely_truncated_share = 0.5;    -- share of the 2D box outside the image: truncation 2
set variable partly_occluded_share = 0.1;      -- share of the outline behind others: occlusion 1
set variable largely_occluded_share = 0.5;     -- share of the outline behind others: occlusion 2
set variable easy_height_px = 40;              -- px: 2D boxes higher than this can be easy
set variable least_height_px = 25;             -- px: lower ones have no difficulty
set variable easy_truncated_share = 0.15;      -- share of the 2D box outside the image: most of an easy one
set variable moderate_truncated_share = 0.3;   -- share of the 2D box outside the image: most of a moderate one
set variable hard_truncated_share = 0.5;       -- share of the 2D box outside the image: most of a hard one

with chosen as (
    select *, state = 'positive' as positive,
           row_number() over (partition by dataset, sequence, frame, track_id, state
                              order by score desc, proposal_id) as place
    from labels
    where (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
      and (getvariable('exported_dataset') is null or dataset = getvariable('exported_dataset'))
      and (getvariable('first_sequence') is null or sequence >= getvariable('first_sequence'))
      and (getvariable('last_sequence') is null or sequence <= getvariable('last_sequence'))
      and (state = 'positive' or getvariable('keep_ignored'))
),
graded as (
    select *, coalesce(truncated_share, 0) as cut, bottom_px - top_px as height_px,
           case when cut >= getvariable('largely_truncated_share') then 2
                when cut >= getvariable('partly_truncated_share') then 1
                else 0 end::integer as truncation,
           case when occluded_share is null then 3
                when occluded_share >= getvariable('largely_occluded_share') then 2
                when occluded_share >= getvariable('partly_occluded_share') then 1
                else 0 end::integer as occlusion,
           case when height_px > getvariable('easy_height_px') and occlusion = 0
                     and cut <= getvariable('easy_truncated_share') then 0
                when height_px > getvariable('least_height_px') and occlusion <= 1
                     and cut <= getvariable('moderate_truncated_share') then 1
                when height_px > getvariable('least_height_px') and occlusion <= 2
                     and cut <= getvariable('hard_truncated_share') then 2
                else -1 end::integer as difficulty
    from chosen
),
named as (
    select *, track_id is not null and place = 1 as on_track,
           if(on_track, track_id, proposal_id) as number_key
    from graded
),
numbered as (
    select *, dense_rank() over (partition by dataset, sequence, positive
                                 order by on_track desc, number_key) - 1 as number
    from named
)
select l.dataset, l.sequence, l.frame, l.proposal_id, l.state, l.positive, l.score, l.source, l.track_id,
       if(positive, number, null)::integer as track_number,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad,
       left_px, top_px, right_px, bottom_px, center_u_px, center_v_px,
       truncated_share, occluded_share, truncation, occlusion, difficulty,
       number_of_points, speed_mps
from numbered l
semi join frames f on (f.dataset, f.sequence, f.frame, f.round) = (l.dataset, l.sequence, l.frame, 1)
                    and f.status = 'ok'
order by l.dataset, l.sequence, l.frame, l.score desc, l.proposal_id
