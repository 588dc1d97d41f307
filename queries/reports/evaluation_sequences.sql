-- Which sequences can be scored: those with labelled objects. frames counts the frames that were
-- built; truths and known_speeds count the labelled objects of the whole sequence.
with shots as (
    select dataset, sequence, count(*) as frames
    from frames
    where status = 'ok' and round = 1
    group by all
),
truths as (
    select dataset, sequence, count(*) as truths, count(speed_mps) as known_speeds
    from ground_truth
    where category != 'DontCare'
    group by all
)
select dataset, sequence, frames, coalesce(truths, 0) as truths,
       coalesce(known_speeds, 0) as known_speeds
from shots
left join truths using (dataset, sequence)
order by dataset, sequence
