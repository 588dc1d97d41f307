-- The frames of a selection that a 3D detector learns from: what it must find, what it must leave
-- alone, and how sure a place must be to count as background.
-- reads: points, ground, height_m, votes_free, votes_static
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable taught_undecided = 'tcrdata_static';  -- presets, with commas between: what is undecided because they take it is learnt as well; empty for none
set variable empty_frames = false;          -- whether frames without a positive label are samples
set variable heading_above_mps = 0.5;       -- m/s times metric scale: a faster label's yaw tells where it heads
set variable negatives = 'sure';            -- background: near (around labels), sure (and where all that stands was surely standing) or everywhere
set variable near_m = 3.0;                  -- m: background reaches this far around a positive label
set variable unsure_reach_m = 2.0;          -- m: a point that is not surely static leaves its surroundings unknown
set variable least_static_votes = 3;        -- sweeps: so many must have seen a surface, for it to be surely static

with taught as (
    select l.*, l.state = 'positive'
                or list_contains(string_split(getvariable('taught_undecided'), ','),
                                 l.ignored_because) as positive
    from labels l
    where getvariable('selection_id') is null or l.selection_id = getvariable('selection_id')
),
labelled as (
    select l.dataset, l.sequence, l.frame,
           list({'x_m': l.x_m, 'y_m': l.y_m, 'z_m': l.z_m, 'length_m': l.length_m,
                 'width_m': l.width_m, 'height_m': l.height_m, 'yaw_rad': l.yaw_rad,
                 'positive': l.positive,
                 'moving': coalesce(l.speed_mps > getvariable('heading_above_mps')
                                                  * s.metric_scale, false)}
                order by l.score desc, l.proposal_id) as labels,
           count(*) filter (l.positive) as positives
    from taught l
    join sequences s using (dataset, sequence)
    group by all
)
select f.dataset, f.sequence, f.frame, b.labels, coalesce(b.positives, 0) as positives,
       getvariable('negatives') as negatives,
       getvariable('near_m')::double as near_m,
       getvariable('unsure_reach_m')::double as unsure_reach_m,
       getvariable('least_static_votes')::integer as least_static_votes
from frames f
left join labelled b using (dataset, sequence, frame)
where f.status = 'ok' and (b.positives > 0 or getvariable('empty_frames'))
order by f.dataset, f.sequence, f.frame
