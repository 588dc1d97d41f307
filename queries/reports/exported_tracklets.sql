-- Tracklets as labels, for exports: one row a box, those filled in out of sight too. With the library where anything was tracked with it.
set variable selection_id = null::varchar;  -- whose labels were followed; NULL = the first

with selected as (
    select selection_id
    from selections
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
    order by selection_id
    limit 1
),
tracked as (
    select t.*, bool_or(t.library) over () as linked
    from tracklets t
    join selected s using (selection_id)
)
select selection_id, format('{}/{}', tracklet_id, frame) as proposal_id, dataset, sequence, frame, round,
       'positive' as state, null::varchar as ignored_because, coalesce(score, passable) as score,
       'tracklet' as source, tracklet_id as track_id,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad,
       null::boolean as yaw_observable,
       left_px, top_px, right_px, bottom_px, center_u_px, center_v_px,
       truncated_share, 1 - visible_share as occluded_share, number_of_points, speed_mps,
       [found] as carried_by
from tracked
where library = linked
order by dataset, sequence, frame, track_id
