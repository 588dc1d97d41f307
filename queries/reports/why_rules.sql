-- What each rule of a selection says of a proposal, in the selection's order. stops: the rule keeps
-- it from being a label. alone: no other rule does. margin: how far value and bound are apart, in
-- bounds (in units where the bound is 0), positive where the rule passes; NULL without both or where
-- the rule abstains. tightest: no rule stops the proposal, and this one let it pass with the smallest
-- margin.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable proposal_id = null::varchar;   -- which proposal; NULL = all

with listed as (
    select selection_id, unnest(rules) as rule, unnest(required) as required,
           generate_subscripts(rules, 1) as place
    from selections
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
judged as (
    select c.selection_id, c.proposal_id, l.place, c.rule, l.required, c.value, c.bound,
           case when c.passed then 'passed' when not c.passed then 'failed' else 'abstained' end
               as verdict,
           coalesce(not c.passed, l.required) as stops,
           if(c.passed, 1, -1)
               * case when c.passed is null then null
                      when isinf(c.bound) then 'infinity'::double
                      when c.bound = 0 then abs(c.value)
                      else abs((c.value - c.bound) / c.bound) end as margin
    from checks c
    join listed l on l.selection_id = c.selection_id and l.rule = c.rule
    where (getvariable('selection_id') is null or c.selection_id = getvariable('selection_id'))
      and (getvariable('proposal_id') is null or c.proposal_id = getvariable('proposal_id'))
)
select *, stops and count(*) filter (stops) over one = 1 as alone,
       count(*) filter (stops) over one = 0 and margin is not null
           and row_number() over (partition by selection_id, proposal_id
                                  order by margin nulls last, place) = 1 as tightest
from judged
window one as (partition by selection_id, proposal_id)
order by selection_id, proposal_id, place
