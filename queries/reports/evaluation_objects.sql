-- What is scored: the positive labels of a selection and the labelled objects of the frames that
-- were built, one row each. kind: label, truth or dont_care (a region in the image that is left out).
-- scored is false outside the region, and for labelled objects that are hidden; moving is NULL
-- where the speed is unknown.
-- Region: in front of a LiDAR a rectangle seen from above; always the 3D centre inside the image.
set variable selection_id = null::varchar;      -- which selection; NULL = every one in the store
set variable scored_dataset = null::varchar;    -- which dataset; NULL = all
set variable first_sequence = null::varchar;    -- from this sequence on; NULL = from the first
set variable last_sequence = null::varchar;     -- up to this sequence; NULL = to the last
set variable scored_sources = null::varchar[];  -- sources of the labels; NULL = all
set variable scored_state = 'positive';         -- labels of this state are predictions
set variable max_lateral_m = 16.0;              -- m * metric_scale: |x| of the region, LiDAR only
set variable min_depth_m = 2.0;                 -- m * metric_scale: nearest z of the region, LiDAR only
set variable max_depth_m = 34.0;                -- m * metric_scale: farthest z of the region, LiDAR only
set variable min_visible_px = 50;               -- pixels: labelled objects that show fewer are hidden
set variable moving_above_mps = 1.0;            -- m/s * metric_scale: labelled objects faster than this move

with shots as (
    select f.dataset, f.sequence, f.frame, f.width_px, f.height_px, f.projection as p,
           f.camera_T_level as t, s.sensor = 'lidar' as has_region, s.metric_scale as scale
    from frames f
    join sequences s using (dataset, sequence, round)
    where f.status = 'ok' and f.round = 1
      and (getvariable('scored_dataset') is null or f.dataset = getvariable('scored_dataset'))
      and (getvariable('first_sequence') is null or f.sequence >= getvariable('first_sequence'))
      and (getvariable('last_sequence') is null or f.sequence <= getvariable('last_sequence'))
),
objects as (
    select 'label' as kind, dataset, sequence, frame, proposal_id as object_id, score,
           x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad,
           null::double[] as level_R_object, null::double[] as object_size_m,
           true as yaw_observable,
           left_px, top_px, right_px, bottom_px, null::integer as visible_px, speed_mps
    from labels
    where (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
      and (getvariable('scored_sources') is null
           or list_contains(getvariable('scored_sources'), source))
      and state = getvariable('scored_state')
    union all
    select if(category = 'DontCare', 'dont_care', 'truth'), dataset, sequence, frame, object_id,
           null, x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, level_R_object,
           object_size_m, yaw_observable, left_px, top_px, right_px, bottom_px, visible_px, speed_mps
    from ground_truth
),
placed as (
    select o.*, s.* exclude (dataset, sequence, frame, t),
           t[1] * x_m + t[2] * y_m + t[3] * z_m + t[4] as camera_x,
           t[5] * x_m + t[6] * y_m + t[7] * z_m + t[8] as camera_y,
           t[9] * x_m + t[10] * y_m + t[11] * z_m + t[12] as camera_z
    from objects o
    join shots s using (dataset, sequence, frame)
),
projected as (
    select *,
           p[1] * camera_x + p[2] * camera_y + p[3] * camera_z + p[4] as u,
           p[5] * camera_x + p[6] * camera_y + p[7] * camera_z + p[8] as v,
           p[9] * camera_x + p[10] * camera_y + p[11] * camera_z + p[12] as depth
    from placed
)
select kind, dataset, sequence, frame, object_id, score,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, level_R_object, object_size_m,
       yaw_observable,
       left_px, top_px, right_px, bottom_px,
       kind != 'dont_care'
           and (not has_region
                or (abs(x_m) <= getvariable('max_lateral_m') * scale
                    and z_m between getvariable('min_depth_m') * scale
                                and getvariable('max_depth_m') * scale))
           and coalesce(depth > 0 and u between 0 and width_px * depth
                                  and v between 0 and height_px * depth, true)
           and coalesce(visible_px >= getvariable('min_visible_px'), true) as scored,
       speed_mps > getvariable('moving_above_mps') * scale as moving
from projected
order by dataset, sequence, frame, kind, score desc, object_id
