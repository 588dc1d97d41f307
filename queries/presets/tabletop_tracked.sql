-- A table, and the boxes that tracking adds where nothing rises above its plane: what templates still
-- match there. Where a thing went out of sight, its way is left undecided: nobody sees it, and it is
-- no background. It takes `tcrdata track` before; without, it is `tabletop`.
-- rules: source, table_shape, table_age, enough_points, height, followed
-- required: source
-- cues: table_clusters
-- follows: tabletop
-- next: tabletop_learned
-- loosened: min_table_age_frames = 2, min_points = 15, min_match = 0.3
set variable taken_source = 'table';
set variable taken_fit = '';
set variable also_taken_source = 'tracklet';
set variable also_taken_fit = 'tracklet';
set variable min_points = 30;
-- A box on its edge is higher than one that stands.
set variable max_height_m = 8;

with on_the_table as (
    select f.proposal_id
    from proposals f
    join proposals t using (dataset, sequence, frame)
    where f.source = 'tracklet' and t.source = 'table'
      and abs((f.x_m - t.x_m) * cos(t.yaw_rad) - (f.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((f.x_m - t.x_m) * sin(t.yaw_rad) + (f.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
-- The more of a thing is seen, the surer; one that was followed, the better it matches.
select p.proposal_id,
       case when p.source = 'tracklet' and p.found <> 'observed' then 'ignore'
            else 'positive' end as state,
       coalesce(c.confidence, 0)::double as score
from proposals p
anti join on_the_table o on o.proposal_id = p.proposal_id
left join confidences c
    on c.proposal_id = p.proposal_id
    and c.module = if(p.source = 'table', 'outline', 'tracklet')
