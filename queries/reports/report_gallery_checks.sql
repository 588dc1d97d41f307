-- What each rule says of some proposals, in the preset's order: the strip below a picture.
set variable selection_id = null::varchar;       -- which selection; NULL = every one in the store
set variable shown_proposals = null::varchar[];  -- ids: which proposals; NULL = all

with rules as (
    select selection_id, unnest(rules) as rule, unnest(required) as required,
           generate_subscripts(rules, 1) as place
    from selections
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
)
select c.selection_id, c.proposal_id, r.place, c.rule, c.value, c.bound, c.passed,
       passed is false or (passed is null and required) as fails
from checks c
join rules r using (selection_id, rule)
where (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
  and (getvariable('shown_proposals') is null
       or list_contains(getvariable('shown_proposals'), c.proposal_id))
order by c.selection_id, c.proposal_id, r.place
