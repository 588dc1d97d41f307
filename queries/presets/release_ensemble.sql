-- The released code's later rounds: what the detector and, with images, the segmenter are nearly sure
-- of and what moves, so that nothing parked becomes a label.
-- rules: source, modules_product, motion_seen, stopped_rays, cycle_error
-- required: source, modules_product, motion_seen
-- cues: flow_ransac, regions_release, objectness3d, objectness2d, visibility
-- ignore: detector_faint
set variable taken_source = 'detector';
set variable taken_fit = 'center_net';
set variable also_taken_source = 'release';
set variable also_taken_fit = 'min_area';
set variable max_cycle_error_m = 0.1;
set variable egomotion_method = 'flow_ransac';

with sure as (
    select proposal_id, list_avg(list(confidence order by module)) as score
    from confidences
    where module in ('motion_2d', 'objectness_3d', 'objectness_2d')
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
