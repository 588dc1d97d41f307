-- The proposal of an id; where there is none, those whose ids are the fewest changes of a letter away.
set variable asked_id = '';  -- which proposal: its id as it was typed
set variable shown = 3;      -- how many

with exact as (
    select proposal_id from proposals where proposal_id = getvariable('asked_id')
)
select proposal_id from exact
union all
(
    select proposal_id
    from proposals
    where not exists (from exact)
    order by levenshtein(proposal_id, getvariable('asked_id')), proposal_id
    limit getvariable('shown')
)
