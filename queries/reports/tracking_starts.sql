-- How many labelled objects the tracking from true first boxes of a selection began with, of how many.
set variable selection_id = null::varchar;  -- whose labels were candidates; NULL = every one in the store

with labelled as (
    select distinct dataset, sequence, object_id
    from ground_truth
    where category != 'DontCare'
),
begun as (
    select distinct dataset, sequence, object_id
    from truth_tracklets
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
)
select count(b.object_id) as begun, count(*) as objects
from labelled l
left join begun b using (dataset, sequence, object_id)
having count(*) > 0
