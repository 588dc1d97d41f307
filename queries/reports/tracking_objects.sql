-- What tracking is scored on, one row a box: labelled objects, a selection's positive labels, and
-- the tracklets found with and without the library, from labels and from true first boxes.
-- kind: truth, label, tracklet, tracklet_library, truth_tracklet or truth_tracklet_library.
-- scored is false outside the region (in front of a LiDAR a rectangle seen from above; always the
-- 3D centre inside the image), and for labelled objects that are hidden.
set variable selection_id = null::varchar;     -- whose labels; NULL = every one in the store
set variable scored_dataset = null::varchar;   -- which dataset; NULL = all
set variable scored_sequence = null::varchar;  -- which sequence; NULL = all
set variable scored_kinds = null::varchar[];   -- which kinds; NULL = all
set variable max_lateral_m = 16.0;             -- m * metric_scale: |x| of the region, LiDAR only
set variable min_depth_m = 2.0;                -- m * metric_scale: nearest z of the region, LiDAR only
set variable max_depth_m = 34.0;               -- m * metric_scale: farthest z of the region, LiDAR only
set variable min_visible_px = 50;              -- pixels: labelled objects that show fewer are hidden
set variable moving_above_mps = 1.0;           -- m/s * metric_scale: labelled objects faster than this move

with objects as (
    select 'truth' as kind, dataset, sequence, frame, object_id as series_id, null as object_id, null as found,
           x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, level_R_object, object_size_m, yaw_observable,
           visible_px, contained_in, speed_mps
    from ground_truth
    where category != 'DontCare'
    union all by name
    select 'label' as kind, dataset, sequence, frame, coalesce(track_id, proposal_id) as series_id,
           x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, speed_mps
    from labels
    where state = 'positive'
      and (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
    union all by name
    select if(library, 'tracklet_library', 'tracklet') as kind, dataset, sequence, frame, tracklet_id as series_id,
           found, x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, speed_mps
    from tracklets
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
    union all by name
    select if(library, 'truth_tracklet_library', 'truth_tracklet') as kind, dataset, sequence, frame,
           tracklet_id as series_id, object_id, found,
           x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, speed_mps
    from truth_tracklets
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
placed as (
    select o.*, f.width_px, f.height_px, f.projection as p, s.sensor = 'lidar' as has_region,
           s.metric_scale as scale,
           f.camera_T_level[1] * x_m + f.camera_T_level[2] * y_m + f.camera_T_level[3] * z_m
               + f.camera_T_level[4] as camera_x,
           f.camera_T_level[5] * x_m + f.camera_T_level[6] * y_m + f.camera_T_level[7] * z_m
               + f.camera_T_level[8] as camera_y,
           f.camera_T_level[9] * x_m + f.camera_T_level[10] * y_m + f.camera_T_level[11] * z_m
               + f.camera_T_level[12] as camera_z
    from objects o
    join frames f using (dataset, sequence, frame)
    join sequences s using (dataset, sequence)
    where f.status = 'ok'
      and (getvariable('scored_dataset') is null or o.dataset = getvariable('scored_dataset'))
      and (getvariable('scored_sequence') is null or o.sequence = getvariable('scored_sequence'))
      and (getvariable('scored_kinds') is null or list_contains(getvariable('scored_kinds'), kind))
),
projected as (
    select *,
           p[1] * camera_x + p[2] * camera_y + p[3] * camera_z + p[4] as u,
           p[5] * camera_x + p[6] * camera_y + p[7] * camera_z + p[8] as v,
           p[9] * camera_x + p[10] * camera_y + p[11] * camera_z + p[12] as depth
    from placed
)
select kind, dataset, sequence, frame, series_id, object_id, found,
       x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad, level_R_object, object_size_m,
       coalesce(yaw_observable, true) as yaw_observable, visible_px, contained_in,
       coalesce(speed_mps > getvariable('moving_above_mps') * scale, false) as moving,
       (not has_region
            or (abs(x_m) <= getvariable('max_lateral_m') * scale
                and z_m between getvariable('min_depth_m') * scale
                            and getvariable('max_depth_m') * scale))
       and coalesce(depth > 0 and u between 0 and width_px * depth
                              and v between 0 and height_px * depth, true)
       and coalesce(visible_px >= getvariable('min_visible_px'), true) as scored
from projected
order by dataset, sequence, kind, series_id, frame
