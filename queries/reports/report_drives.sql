-- What came of each drive, those with the most labels first.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable drives_listed = 2000;          -- drives: no more than these

with shots as (
    select dataset, sequence, round, count(*) as frames,
           count(*) filter (status != 'ok') as frames_failed
    from frames
    group by all
),
candidates as (
    select dataset, sequence, round, count(*) as candidates
    from proposals
    group by all
),
found as (
    select dataset, sequence, round, count(*) filter (state = 'positive') as positives,
           count(*) filter (state = 'ignore') as ignored,
           count(distinct track_id) filter (state = 'positive') as tracks,
           count(distinct frame) filter (state = 'positive') as frames_with_labels
    from labels
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
    group by all
)
select s.dataset, s.sequence, coalesce(frames, 0) as frames,
       coalesce(frames_failed, 0) as frames_failed, coalesce(candidates, 0) as candidates,
       coalesce(positives, 0) as positives, coalesce(ignored, 0) as ignored,
       coalesce(tracks, 0) as tracks, coalesce(frames_with_labels, 0) as frames_with_labels,
       count(*) over () as drives
from sequences s
left join shots using (dataset, sequence, round)
left join candidates using (dataset, sequence, round)
left join found using (dataset, sequence, round)
order by positives desc, s.dataset, s.sequence
limit getvariable('drives_listed')
