-- What became of the labels of selection A in selection B, counted three ways (level): in all, by
-- sequence, and by the rules whose verdict changed.
-- change: kept (the same box), moved (the same object in another box), gained, lost, to_ignore and
-- to_positive (the state changed), ignore_kept, ignore_gained, ignore_lost. A label is the same
-- object when its proposal is, else when the two are each other's nearest in the frame and near.
-- rules: those that keep it out of one selection and not of the other; none when the preset's own
-- select decided. evidence: judged in both, or only in one because the other never measured it.
-- Examples are proposals to ask `why` about; distances are medians and 90th percentiles.
set variable selection_a = null::varchar;  -- id of the selection to start from
set variable selection_b = null::varchar;  -- id of the selection to compare with it
set variable near_share = 0.5;             -- share of the shorter length: centres so close are one object
set variable same_box_m = 0.000001;        -- m and rad: boxes that differ by less are the same
set variable max_examples = 3;             -- examples: a group names at most so many

with a as (from labels where selection_id = getvariable('selection_a')),
b as (from labels where selection_id = getvariable('selection_b')),
only_a as (from a anti join b using (proposal_id) where state = 'positive'),
only_b as (from b anti join a using (proposal_id) where state = 'positive'),
-- Each other's nearest: at most one partner a label, whatever the order of the rows.
neighbours as (
    select a.proposal_id as id_a, b.proposal_id as id_b,
           sqrt(pow(a.x_m - b.x_m, 2) + pow(a.z_m - b.z_m, 2)) as distance_m
    from only_a a
    join only_b b using (dataset, sequence, frame)
    where distance_m <= getvariable('near_share') * least(a.length_m, b.length_m)
    qualify row_number() over (partition by id_a order by distance_m, id_b) = 1
        and row_number() over (partition by id_b order by distance_m, id_a) = 1
),
pairs as (
    select a.proposal_id as id_a, b.proposal_id as id_b
    from a full join b using (proposal_id)
    where coalesce(a.proposal_id, '') not in (select id_a from neighbours)
      and coalesce(b.proposal_id, '') not in (select id_b from neighbours)
    union all
    select id_a, id_b from neighbours
),
compared as (
    select coalesce(b.proposal_id, a.proposal_id) as proposal_id,
           coalesce(a.dataset, b.dataset) as dataset, coalesce(a.sequence, b.sequence) as sequence,
           a.state as state_a, b.state as state_b,
           sqrt(pow(a.x_m - b.x_m, 2) + pow(a.y_m - b.y_m, 2) + pow(a.z_m - b.z_m, 2)) as centre_m,
           abs(mod(a.yaw_rad - b.yaw_rad + 9 * pi(), 2 * pi()) - pi()) as turn_rad,
           greatest(abs(a.length_m - b.length_m), abs(a.width_m - b.width_m),
                    abs(a.height_m - b.height_m)) as size_m,
           case when state_a = 'positive' and state_b = 'positive'
                    then if(greatest(centre_m, turn_rad, size_m) > getvariable('same_box_m'),
                            'moved', 'kept')
                when state_a = 'positive' then if(state_b is null, 'lost', 'to_ignore')
                when state_b = 'positive' then if(state_a is null, 'gained', 'to_positive')
                when state_a is null then 'ignore_gained'
                when state_b is null then 'ignore_lost'
                else 'ignore_kept' end as change
    from pairs
    left join a on a.proposal_id = id_a
    left join b on b.proposal_id = id_b
),
asked as (
    select proposal_id, change in ('gained', 'to_positive') as comes_in
    from compared
    where change in ('gained', 'lost', 'to_positive', 'to_ignore')
),
judged as (
    select selection_id, proposal_id,
           list_filter(rules, lambda rule, place: blocked & (1::bigint << (place - 1)) <> 0)
               as blocking
    from verdicts
    semi join asked using (proposal_id)
    where selection_id in (getvariable('selection_a'), getvariable('selection_b'))
),
flipped as (
    select proposal_id,
           list_filter(if(comes_in, va.blocking, vb.blocking), lambda rule:
                       not list_contains(if(comes_in, vb.blocking, va.blocking), rule)) as rules,
           case when va.blocking is null then 'only in B' when vb.blocking is null then 'only in A'
                else 'both' end as evidence
    from asked
    left join (from judged where selection_id = getvariable('selection_a')) va using (proposal_id)
    left join (from judged where selection_id = getvariable('selection_b')) vb using (proposal_id)
)
select case when grouping(dataset) = 0 then 'sequence' when grouping(rules) = 0 then 'rules'
            else 'all' end as level,
       change, dataset, sequence, rules, evidence, count(*) as labels,
       min(proposal_id, getvariable('max_examples')) as examples,
       quantile_cont(centre_m, [0.5, 0.9]) as centre_m,
       quantile_cont(turn_rad, [0.5, 0.9]) as turn_rad,
       quantile_cont(size_m, [0.5, 0.9]) as size_m
from compared
left join flipped using (proposal_id)
group by grouping sets ((change), (change, dataset, sequence), (change, rules, evidence))
having level <> 'rules' or evidence is not null
order by level, change, labels desc, dataset, sequence, rules, evidence
