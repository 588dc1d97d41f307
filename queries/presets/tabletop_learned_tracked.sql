-- A table after learning, and the boxes that tracking adds where none of its labels is: what templates
-- still match. Where a thing went out of sight, its way is left undecided.
-- rules: source, table_shape, table_age, enough_points, height, detected_age, detected_share,
--   detected_score, detected_core_share, detected_points, followed
-- required: source
-- cues: table_clusters, detected_objects
-- follows: tabletop_learned
-- loosened: min_table_age_frames = 2, min_points = 15,
--   min_detected_age_frames = 2, min_visible_share = 0.1, min_best_half_score = 0.1,
--   max_detected_core_share = 0.5, min_detected_points = 1, min_match = 0.3
set variable taken_source = 'table';
set variable taken_fit = '';
set variable also_taken_source = 'detected,tracklet';
set variable also_taken_fit = 'persistent,tracklet';
set variable min_points = 30;
-- A box on its edge is higher than one that stands.
set variable max_height_m = 8;

-- A thing of the table comes first, then what was detected, then what was followed.
with ranked as (
    select p.*, list_position(['table', 'detected', 'tracklet'], p.source) as place
    from proposals p
),
under_another as (
    select d.proposal_id
    from ranked d
    join ranked t using (dataset, sequence, frame)
    where t.place < d.place
      and abs((d.x_m - t.x_m) * cos(t.yaw_rad) - (d.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((d.x_m - t.x_m) * sin(t.yaw_rad) + (d.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
select r.proposal_id,
       case when r.source = 'tracklet' and r.found <> 'observed' then 'ignore'
            else 'positive' end as state,
       coalesce(c.confidence, 0)::double as score
from ranked r
anti join under_another u on u.proposal_id = r.proposal_id
left join confidences c
    on c.proposal_id = r.proposal_id
    and c.module = case r.source when 'table' then 'outline' when 'tracklet' then 'tracklet'
                                 else 'persistence' end
