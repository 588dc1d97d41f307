-- Which paths become entries of the library: those that obey the flow and travel through what is
-- object-like or invisible. Of many the ones that travel farthest, then by name.
-- source: section 3.5, eq. 9
set variable entries_selection = null::varchar;  -- whose labels' paths; NULL = of every selection
set variable min_passable = 0.99;       -- share: mean p along the path
set variable max_flow_error_px = 5.0;   -- px: distance of the flow in the box from the projected motion; paths without flow pass
set variable min_entry_frames = 6;      -- frames: shorter paths tell too little
set variable min_entry_travel_m = 0.0;  -- m * metric_scale: paths that go less far
set variable max_entries = 10000;       -- entries: so many at most

select trajectory_id, tracklet_id, frames, metric_scale, first_step_m,
       along_m, down_m, across_m, turn_rad
from trajectories
where (getvariable('entries_selection') is null or selection_id = getvariable('entries_selection'))
  and passable >= getvariable('min_passable')::double
  and coalesce(flow_error_px <= getvariable('max_flow_error_px')::double, true)
  and frames >= getvariable('min_entry_frames')
  and travel_m >= getvariable('min_entry_travel_m')::double * metric_scale
order by travel_m / metric_scale desc, trajectory_id
limit getvariable('max_entries')
