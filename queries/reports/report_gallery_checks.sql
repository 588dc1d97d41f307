-- What each rule says of some proposals, in the preset's order: the strip below a picture.
set variable selection_id = null::varchar;       -- which selection; NULL = every one in the store
set variable shown_proposals = null::varchar[];  -- ids: which proposals; NULL = all

with asked as (
    select * exclude (failed, abstained),
           unnest(range(1, len(rules) + 1)) as place
    from verdicts
    where (getvariable('selection_id') is null or selection_id = getvariable('selection_id'))
      and (getvariable('shown_proposals') is null
           or list_contains(getvariable('shown_proposals'), proposal_id))
)
select selection_id, proposal_id, place, rules[place] as rule, value[place] as value,
       bound[place] as bound, passed[place] as passed,
       (blocked >> (place - 1)::integer) & 1 = 1 as fails,
       bit_count(blocked) as failures
from asked
order by selection_id, proposal_id, place
