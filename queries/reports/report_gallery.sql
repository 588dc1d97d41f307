-- Which candidates the report shows, a few of each kind and never two of one track in a kind:
--   accepted: a fair sample, by the md5 of the id, so that nobody picks what looks good;
--   barely: accepted, with the smallest margin to a bound that it had to keep;
--   nearly: one rule alone rejects it and by little, or its label says ignore; each rule in turn;
--   rejected: of the first rule that fails it, the best supported candidate and one by the md5.
-- What the camera sees goes before what only the points show. A margin is |value - bound| over the
-- larger of the two; rules without numbers have none. In `deciding_rule` the smallest margin counts
-- for what passed, the first failure in the preset's order for what failed.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable accepted_shown = 12;  -- candidates: how many of this kind
set variable barely_shown = 6;     -- candidates: how many of this kind
set variable nearly_shown = 12;    -- candidates: how many of this kind
set variable rejected_shown = 18;  -- candidates: how many of this kind

with rules as (
    select selection_id, unnest(rules) as rule, unnest(required) as required,
           generate_subscripts(rules, 1) as place
    from selections
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
measured as (
    select c.selection_id, c.proposal_id, r.place, c.passed,
           passed is false or (passed is null and required) as fails,
           case when isfinite(value) and isfinite(bound)
                then abs(value - bound) / nullif(greatest(abs(value), abs(bound)), 0) end as margin
    from checks c
    join rules r using (selection_id, rule)
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
verdicts as (
    select selection_id, proposal_id, count(*) filter (fails) as failures,
           min(place) filter (fails) as first_failed,
           max(margin) filter (fails) as missed_by,
           arg_min(place, margin) filter (passed) as nearest_passed,
           min(margin) filter (passed) as kept_by
    from measured
    group by all
),
candidates as (
    select v.*, l.state, p.dataset, p.sequence, p.frame, p.number_of_points,
           coalesce(p.track_id, p.region_id) as object, p.left_px is null as unseen,
           md5(v.proposal_id) as lot,
           case when l.state = 'positive' then 'accepted'
                when l.state = 'ignore' or (failures = 1 and missed_by is not null) then 'nearly'
                else 'rejected' end as kind
    from verdicts v
    join proposals p using (proposal_id)
    left join labels l using (selection_id, proposal_id)
),
accepted as (
    select * from candidates where kind = 'accepted'
    qualify row_number() over (partition by selection_id, object order by unseen, lot) = 1
),
barely as (
    select * from candidates where kind = 'accepted' and kept_by is not null
    qualify row_number() over (partition by selection_id, object
                               order by unseen, kept_by, proposal_id) = 1
),
nearly as (
    select * from candidates where kind = 'nearly'
    qualify row_number() over (partition by selection_id, object
                               order by unseen, missed_by nulls last, proposal_id) = 1
),
taken as (
    select 1 as kind_place, 'accepted' as kind, * exclude (kind), nearest_passed as decided_by,
           row_number() over (partition by selection_id order by unseen, lot) as place
    from accepted
    qualify place <= getvariable('accepted_shown')
    union all
    select 2, 'barely', * exclude (kind), nearest_passed,
           row_number() over (partition by selection_id
                              order by unseen, kept_by, proposal_id) as place
    from barely
    qualify place <= getvariable('barely_shown')
    union all
    select 3, 'nearly', * exclude (kind, turn), first_failed,
           row_number() over (partition by selection_id
                              order by turn, missed_by nulls last, proposal_id) as place
    from (
        select *, row_number() over (partition by selection_id, first_failed, state
                                     order by unseen, missed_by nulls last, proposal_id) as turn
        from nearly
    )
    qualify place <= getvariable('nearly_shown')
    union all
    select 4, 'rejected', * exclude (kind, by_lot, by_points, turn), first_failed,
           row_number() over (partition by selection_id
                              order by turn, first_failed nulls first, lot) as place
    from (
        select *, least(by_lot * 2, by_points * 2 - 1) as turn
        from (
            select *,
                   row_number() over (partition by selection_id, first_failed
                                      order by unseen, lot) as by_lot,
                   row_number() over (partition by selection_id, first_failed
                                      order by unseen, number_of_points desc, lot) as by_points
            from candidates
            where kind = 'rejected'
        )
        where by_lot = 1 or by_points = 1
    )
    qualify place <= getvariable('rejected_shown')
)
select t.selection_id, t.kind, t.place, t.proposal_id, t.state, t.failures, t.missed_by, t.kept_by,
       r.rule as deciding_rule, l.score,
       p.dataset, p.sequence, p.frame, p.round, p.track_id, p.source, p.fit, p.found,
       p.metric_scale, p.x_m, p.y_m, p.z_m, p.length_m, p.width_m, p.height_m, p.yaw_rad,
       p.left_px, p.top_px, p.right_px, p.bottom_px, p.range_m, p.number_of_points, p.speed_mps,
       p.occluded_share
from taken t
join proposals p using (proposal_id)
left join rules r on r.selection_id = t.selection_id and r.place = t.decided_by
left join labels l on l.selection_id = t.selection_id and l.proposal_id = t.proposal_id
order by t.selection_id, kind_place, t.place
