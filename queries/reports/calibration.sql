-- How far each module's confidences can be trusted: what the other modules say of the same proposals,
-- by the module's own confidence. calibrated rises with it: isotonic regression, the largest over
-- beginnings of the smallest over ends of the mean between them.
set variable calibrated_round = 1;  -- EM round; what was measured in round 1 counts in each
set variable bins = 10;             -- bins: of equal width between 0 and 1

-- Sums of decimals are the same in any order, those of doubles are not.
with said as (
    select proposal_id, module, max(confidence)::decimal(18, 12) as confidence
    from confidences
    where confidence is not null and round in (1, getvariable('calibrated_round'))
    group by all
),
together as (
    select proposal_id, sum(confidence) as total, count(*) as modules
    from said
    group by all
    having count(*) > 1
),
judged as (
    select module,
           least(floor(confidence::double * getvariable('bins')), getvariable('bins') - 1)::integer
               as bin,
           ((total - confidence) / (modules - 1))::decimal(18, 12) as others
    from said
    join together using (proposal_id)
),
binned as (
    select module, bin, count(*) as proposals, sum(others) as total
    from judged
    group by all
),
summed as (
    select *, sum(proposals) over up_to as proposals_up_to, sum(total) over up_to as total_up_to
    from binned
    window up_to as (partition by module order by bin)
),
spans as (
    select a.module, a.bin as first_bin, b.bin as last_bin,
           (b.total_up_to - a.total_up_to + a.total)::double
               / (b.proposals_up_to - a.proposals_up_to + a.proposals) as mean
    from summed a
    join summed b on b.module = a.module and b.bin >= a.bin
),
smallest as (
    select k.module, k.bin, s.first_bin, min(s.mean) as mean
    from binned k
    join spans s on s.module = k.module and k.bin between s.first_bin and s.last_bin
    group by all
),
isotonic as (
    select module, bin, max(mean) as calibrated from smallest group by all
)
select getvariable('calibrated_round')::integer as round, module,
       (bin / getvariable('bins'))::double as confidence_low,
       ((bin + 1) / getvariable('bins'))::double as confidence_high,
       proposals, total::double / proposals as others_confidence, calibrated::double as calibrated
from binned
join isotonic using (module, bin)
order by module, bin
