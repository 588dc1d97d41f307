-- The frames that an export is about: those that can be read, with or without labels, their cameras and where their image and points lie.
set variable exported_dataset = null::varchar;  -- which dataset; NULL = all
set variable first_sequence = null::varchar;   -- name of the first sequence, as text sorts; NULL = from the beginning
set variable last_sequence = null::varchar;    -- name of the last one; NULL = to the end
set variable with_files = true;                -- true or false: image_path and points_path are looked up

select f.dataset, f.sequence, f.frame, s.root, s.sensor, s.metric_scale, f.timestamp_ns,
       f.width_px, f.height_px, f.projection, f."camera_T_level", f."level_T_sensor",
       f.has_image, f.number_of_points, i.image.path as image_path, w.path as points_path
from frames f
join sequences s on (s.dataset, s.sequence, s.round) = (f.dataset, f.sequence, 1)
left join (from images where getvariable('with_files')) i
       on (i.dataset, i.sequence, i.frame, i.round) = (f.dataset, f.sequence, f.frame, 1)
left join (from sweeps where getvariable('with_files')) w
       on (w.dataset, w.sequence, w.frame, w.round) = (f.dataset, f.sequence, f.frame, 1)
where f.round = 1 and f.status = 'ok'
  and (getvariable('exported_dataset') is null or f.dataset = getvariable('exported_dataset'))
  and (getvariable('first_sequence') is null or f.sequence >= getvariable('first_sequence'))
  and (getvariable('last_sequence') is null or f.sequence <= getvariable('last_sequence'))
order by f.dataset, f.sequence, f.frame
