-- How a selection agrees with the others of the store: positive labels that both have, that only one
-- has, and those that it has and the other leaves undecided. shared: of the labels of either, the
-- share that both have.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store

with own as (
    select selection_id, proposal_id from labels
    where state = 'positive'
      and (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
),
in_common as (
    select o.selection_id, l.selection_id as other_id,
           count(*) filter (l.state = 'positive') as in_both,
           count(*) filter (l.state = 'ignore') as ignored_there
    from own o
    join labels l on l.proposal_id = o.proposal_id and l.selection_id <> o.selection_id
    group by all
),
totals as (
    select selection_id, count(*) filter (state = 'positive') as labels from labels group by all
)
select s.selection_id, s.name as selection, t.selection_id as other_id, t.name as other,
       coalesce(in_both, 0) as in_both,
       coalesce(a.labels, 0) - coalesce(in_both, 0) as only_selection,
       coalesce(b.labels, 0) - coalesce(in_both, 0) as only_other,
       coalesce(ignored_there, 0) as ignored_by_other,
       coalesce(in_both, 0) / nullif(only_selection + only_other + coalesce(in_both, 0), 0) as shared
from selections s
join selections t on t.selection_id <> s.selection_id and t.round = s.round
left join in_common o on o.selection_id = s.selection_id and o.other_id = t.selection_id
left join totals a on a.selection_id = s.selection_id
left join totals b on b.selection_id = t.selection_id
where getvariable('selection_id') is null or s.selection_id = getvariable('selection_id')
order by s.selection_id, shared desc, other_id
