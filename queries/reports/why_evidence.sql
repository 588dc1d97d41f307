-- The numbers behind a proposal's verdicts, one a row: what each module says of it, how sound the
-- egomotion of its frame is, and what was measured on its points, its box and its track. Of modules,
-- value is what the confidence was made from.
set variable proposal_id = null::varchar;  -- which proposal; NULL = all

with asked as (
    select *
    from proposals
    where getvariable('proposal_id') is null or proposal_id = getvariable('proposal_id')
),
said as (
    select a.proposal_id, 1 as part, 'module' as about, c.module as name, c.raw_value as value, c.unit,
           c.confidence
    from asked a
    join confidences c
        on c.dataset = a.dataset and c.sequence = a.sequence and c.proposal_id = a.proposal_id
),
moved as (
    select a.proposal_id, e.method, unnest([
        {name: 'cycle_error', value: e.cycle_error_m, unit: 'm'},
        {name: 'alignment', value: e.alignment_share, unit: 'share'},
        {name: 'alignment_look', value: e.alignment_frames::double, unit: 'frames'},
        {name: 'residual', value: e.residual_m, unit: 'm'},
        {name: 'inliers', value: e.inlier_share, unit: 'share'},
        {name: 'translation', value: e.translation_m, unit: 'm'},
        {name: 'rotation', value: e.rotation_rad, unit: 'rad'}]) as row
    from asked a
    join egomotions e
        on e.dataset = a.dataset and e.sequence = a.sequence and e.frame = a.frame
        and e.round = a.round
),
measured as (
    select proposal_id, unnest([
        {about: 'points', name: 'number_of_points', value: number_of_points::double, unit: 'points'},
        {about: 'points', name: 'bottom_above_ground', value: bottom_above_ground_m, unit: 'm'},
        {about: 'points', name: 'top_above_ground', value: top_above_ground_m, unit: 'm'},
        {about: 'points', name: 'occluded', value: occluded_share, unit: 'share'},
        {about: 'points', name: 'truncated', value: truncated_share, unit: 'share'},
        {about: 'free space', name: 'core_points', value: core_points::double, unit: 'points'},
        {about: 'free space', name: 'core', value: core_share, unit: 'share'},
        {about: 'free space', name: 'free', value: free_share, unit: 'share'},
        {about: 'free space', name: 'votes_free_mean', value: votes_free_mean, unit: 'sweeps'},
        {about: 'motion', name: 'motion_3d', value: motion_3d_m, unit: 'm'},
        {about: 'motion', name: 'motion_2d', value: motion_2d_px, unit: 'px'},
        {about: 'motion', name: 'motion_cosine', value: motion_cosine, unit: ''},
        {about: 'motion', name: 'motion_threshold', value: motion_threshold_m, unit: 'm'},
        {about: 'motion', name: 'center_surround', value: center_surround_chi2, unit: 'chi-square'},
        {about: 'motion', name: 'voxels_a', value: voxels_a::double, unit: 'voxels'},
        {about: 'motion', name: 'voxels_b', value: voxels_b::double, unit: 'voxels'},
        {about: 'motion', name: 'size_rank', value: size_rank::double, unit: ''},
        {about: 'shape', name: 'edge', value: edge_share, unit: 'share'},
        {about: 'shape', name: 'fill', value: fill_share, unit: 'share'},
        {about: 'shape', name: 'fit_residual', value: fit_residual_m, unit: 'm'},
        {about: 'track', name: 'age', value: age_frames::double, unit: 'frames'},
        {about: 'track', name: 'span', value: span_frames::double, unit: 'frames'},
        {about: 'track', name: 'travel', value: travel_m, unit: 'm'},
        {about: 'track', name: 'straightness', value: straightness, unit: 'ratio'},
        {about: 'track', name: 'speed', value: speed_mps, unit: 'm/s'},
        {about: 'track', name: 'at_clip_edge', value: at_clip_edge::integer::double, unit: ''},
        {about: 'track', name: 'core', value: track_core_share, unit: 'share'},
        {about: 'track', name: 'points', value: track_points, unit: 'points'},
        {about: 'track', name: 'height', value: track_height_m, unit: 'm'},
        {about: 'track', name: 'nearest_range', value: track_range_min_m, unit: 'm'},
        {about: 'track', name: 'refinement_residual', value: refinement_residual_m, unit: 'm'},
        {about: 'track', name: 'from_observation', value: frames_from_observation::double,
         unit: 'frames'},
        {about: 'track', name: 'overlapped', value: overlapped_share, unit: 'share'}]) as row
    from asked
)
select * exclude (part)
from (
    from said
    union all
    select proposal_id, 2, 'egomotion, ' || method, row.name, row.value, row.unit, null
    from moved
    union all
    select proposal_id,
           2 + list_position(['points', 'free space', 'motion', 'shape', 'track'], row.about),
           row.about, row.name, row.value, row.unit, null
    from measured
)
where value is not null or confidence is not null
order by proposal_id, part, about, name
