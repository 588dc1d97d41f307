-- The frames of a selection that a 2D segmenter learns from: boxes whose points span what is
-- object, and how far around them it is background.
-- reads: image, points, ground, height_m, votes_free, votes_static
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable least_side_px = 8.0;           -- px: smaller labels teach nothing
set variable largest_truncated_share = 0.5;  -- share: labels that lie farther outside the image teach nothing
set variable band_px = 32.0;                -- px: background reaches this far around a label
set variable least_static_votes = 3;        -- sweeps: so many must have seen a surface, for it to be surely static

with labelled as (
    select dataset, sequence, frame,
           list({'x_m': x_m, 'y_m': y_m, 'z_m': z_m, 'length_m': length_m, 'width_m': width_m,
                 'height_m': height_m, 'yaw_rad': yaw_rad,
                 'positive': state = 'positive'
                             and least(right_px - left_px, bottom_px - top_px)
                                 >= getvariable('least_side_px')
                             and truncated_share <= getvariable('largest_truncated_share')}
                order by score desc, proposal_id) as labels,
           count(*) filter (state = 'positive') as positives
    from labels
    where (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
      and left_px is not null
    group by all
)
select f.dataset, f.sequence, f.frame, b.labels, b.positives,
       getvariable('band_px')::double as band_px,
       getvariable('least_static_votes')::integer as least_static_votes
from frames f
join labelled b using (dataset, sequence, frame)
where f.status = 'ok' and f.has_image and b.positives > 0
order by f.dataset, f.sequence, f.frame
