-- The funnel of a selection: what each of its rules, in order, does to the proposals.
-- judged = passed + failed + abstained. alone: kept out by this rule and no other, so that is what
-- comes in without it; near: of these as many as miss the bound by little, so that is what a looser
-- bound brings. left: proposals that this rule and those before it let through. fails_too: of the
-- proposals that this rule fails, the share that each other rule fails too. margin: distance to the
-- bound as a share of it, negative where the rule fails; its 10th and 50th percentile.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable near_margin = 0.1;             -- share of the bound: a miss by up to this is near

with judged as materialized (
    select selection_id, failed, abstained, blocked, margin
    from verdicts
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
steps as (
    select selection_id, name, unnest(rules) as rule, unnest(required) as required,
           generate_subscripts(rules, 1) as place, 1::bigint << (place - 1) as bit
    from selections
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
patterns as (
    select selection_id, failed, abstained, blocked, count(*) as proposals
    from judged
    group by all
),
counted as (
    select selection_id, place,
           sum(proposals)::bigint as judged,
           coalesce(sum(proposals) filter (failed & bit = 0 and abstained & bit = 0), 0)::bigint
               as passed,
           coalesce(sum(proposals) filter (failed & bit <> 0), 0)::bigint as failed,
           coalesce(sum(proposals) filter (abstained & bit <> 0), 0)::bigint as abstained,
           coalesce(sum(proposals) filter (blocked = bit), 0)::bigint as alone,
           coalesce(sum(proposals) filter (blocked & (2 * bit - 1) = 0), 0)::bigint as left_over
    from steps
    join patterns using (selection_id)
    group by all
),
shared_failures as (
    select selection_id, place,
           map_from_entries(list((other, share) order by other_place)) as fails_too
    from (
        select s.selection_id, s.place, o.rule as other, o.place as other_place,
               sum(proposals) filter (p.failed & o.bit <> 0) as in_both,
               coalesce(in_both, 0) / sum(proposals) as share
        from steps s
        join steps o on o.selection_id = s.selection_id and o.place <> s.place
        join patterns p on p.selection_id = s.selection_id and p.failed & s.bit <> 0
        group by all
    )
    group by all
),
margins as (
    select selection_id, place, quantile_cont(margin, [0.1, 0.5]) as percentiles
    from (
        select selection_id, unnest(margin) as margin, generate_subscripts(margin, 1) as place
        from judged
    )
    where margin is not null
    group by all
),
nearly as (
    select selection_id, bit_count(blocked - 1) + 1 as place, count(*) as near
    from judged
    where bit_count(blocked) = 1
      and margin[bit_count(blocked - 1) + 1] between -getvariable('near_margin') and 0
    group by all
)
select s.selection_id, s.name as selection, s.place, s.rule, s.required,
       c.judged, c.passed, c.failed, c.abstained, c.alone, coalesce(n.near, 0) as near,
       c.left_over, m.percentiles[1] as margin_p10, m.percentiles[2] as margin_p50,
       coalesce(o.fails_too, map {}) as fails_too
from steps s
join counted c using (selection_id, place)
left join margins m using (selection_id, place)
left join nearly n using (selection_id, place)
left join shared_failures o using (selection_id, place)
order by s.selection_id, s.place
