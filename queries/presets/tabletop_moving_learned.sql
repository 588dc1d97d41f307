-- A table on which what moved was learnt from: of the things that rise above its plane those that
-- moved and those that the detector takes for objects, and what it finds at one place in many frames
-- where no such thing is.
-- rules: source, table_shape, table_age, enough_points, height, table_witness, detected_age,
--   detected_share, detected_score, detected_core_share, detected_points
-- required: source
-- cues: table_clusters, table_motion, objectness3d, detected_objects
-- ignore: tabletop
-- loosened: min_table_age_frames = 2, min_points = 15, min_witness = 0.3,
--   min_detected_age_frames = 2, min_visible_share = 0.1, min_best_half_score = 0.1,
--   max_detected_core_share = 0.5, min_detected_points = 1
set variable taken_source = 'table';
set variable taken_fit = '';
set variable also_taken_source = 'detected';
set variable also_taken_fit = 'persistent';
set variable min_points = 30;
-- A box on its edge is higher than one that stands.
set variable max_height_m = 8;

with on_the_table as (
    select d.proposal_id
    from proposals d
    join proposals t using (dataset, sequence, frame)
    where d.source = 'detected' and t.source = 'table'
      and abs((d.x_m - t.x_m) * cos(t.yaw_rad) - (d.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((d.x_m - t.x_m) * sin(t.yaw_rad) + (d.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
anti join on_the_table o on o.proposal_id = p.proposal_id
left join confidences c
    on c.proposal_id = p.proposal_id
    and c.module = if(p.source = 'table', 'outline', 'persistence')
