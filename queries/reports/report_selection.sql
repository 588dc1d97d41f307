-- What a selection is and how much came of it: one row a selection, the head of the report.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store

with found as (
    select selection_id,
           count(*) filter (state = 'positive') as positives,
           count(*) filter (state = 'ignore') as ignored,
           count(distinct track_id) filter (state = 'positive') as tracks,
           count(distinct (dataset, sequence)) filter (state = 'positive') as drives_with_labels,
           count(distinct (dataset, sequence, frame)) filter (state = 'positive')
               as frames_with_labels
    from labels
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
    group by all
),
drives as (
    select round, count(*) as drives, list(distinct dataset order by dataset) as datasets
    from sequences
    group by all
),
shots as (
    select round, count(*) as frames, count(*) filter (status != 'ok') as frames_failed,
           count(*) filter (status = 'ok' and not has_image) as frames_without_image
    from frames
    group by all
)
select s.selection_id, s.name, s.preset, s.round, s.snapshot, s.proposals_judged,
       len(s.rules) as rules,
       coalesce(found.positives, 0) as positives, coalesce(found.ignored, 0) as ignored,
       coalesce(found.tracks, 0) as tracks, coalesce(drives_with_labels, 0) as drives_with_labels,
       coalesce(frames_with_labels, 0) as frames_with_labels,
       coalesce(drives, 0) as drives, coalesce(datasets, []) as datasets,
       coalesce(frames, 0) as frames, coalesce(frames_failed, 0) as frames_failed,
       coalesce(frames_without_image, 0) as frames_without_image
from selections s
left join found using (selection_id)
left join drives using (round)
left join shots using (round)
where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
order by s.name, s.selection_id
