-- The paper's later rounds: regions of motion and what the detector found, where the modules together
-- are so sure that no two of three could be, or one is exceedingly sure.
-- rules: source, enough_points, modules_sum, cycle_error
-- required: source, modules_sum
-- cues: flow_ransac, regions_paper, objectness3d, objectness2d, visibility
-- ignore: detector_faint
set variable taken_source = 'detector';
set variable taken_fit = 'center_net';
set variable also_taken_source = 'paper';
set variable also_taken_fit = 'min_area';
set variable min_points = 10;
set variable max_cycle_error_m = 0.25;
set variable egomotion_method = 'flow_ransac';

with sure as (
    select proposal_id, list_avg(list(confidence order by module)) as score
    from confidences
    where module in ('motion_3d', 'objectness_3d', 'objectness_2d')
    group by proposal_id
),
ranked as (
    select p.*, coalesce(s.score, 0)::double as score
    from proposals p
    left join sure s on s.proposal_id = p.proposal_id
),
-- Two sources may claim one place in a frame: the surer one has it.
under_a_surer as (
    select d.proposal_id
    from ranked d
    join ranked t using (dataset, sequence, frame)
    where (t.score, t.proposal_id) > (d.score, d.proposal_id)
      and abs((d.x_m - t.x_m) * cos(t.yaw_rad) - (d.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((d.x_m - t.x_m) * sin(t.yaw_rad) + (d.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
select r.proposal_id, 'positive' as state, r.score
from ranked r
anti join under_a_surer u on u.proposal_id = r.proposal_id
