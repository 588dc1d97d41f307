-- Which candidates the report shows, a few of each kind:
--   accepted: a fair sample, by the md5 of the id, so that nobody picks what looks good;
--   barely: accepted, with the smallest margin to a bound that it had to keep, one an object;
--   nearly: one rule alone rejects it and by little, or its label says ignore; one an object, each
--     rule in turn;
--   rejected: of the first rule that keeps candidates out, the best supported and one by the md5.
-- What the camera sees goes before what only the points show. `deciding_rule` is the rule of the
-- smallest margin for what was accepted, the first one that keeps it out for the others.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable accepted_shown = 12;  -- candidates: how many of this kind
set variable barely_shown = 6;     -- candidates: how many of this kind
set variable nearly_shown = 12;    -- candidates: how many of this kind
set variable rejected_shown = 18;  -- candidates: how many of this kind

with judged as (
    select selection_id, proposal_id, rules, blocked, bit_count(blocked) as failures,
           -- The lowest bit that is set: the first rule in the preset's order.
           if(blocked = 0, null, bit_count((blocked & -blocked) - 1) + 1) as first_failed,
           list_min(list_filter(margin, lambda m: m >= 0 and isfinite(m))) as kept_by,
           -list_min(list_filter(margin, lambda m: m < 0 and isfinite(m))) as missed_by,
           margin
    from verdicts
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
candidates as (
    select v.selection_id, v.proposal_id, v.failures, v.first_failed, v.kept_by, v.missed_by,
           if(v.blocked = 0, list_position(v.margin, v.kept_by), v.first_failed) as decided_by,
           l.state, p.number_of_points, p.left_px is null as unseen,
           coalesce(p.track_id, p.region_id) as object, md5(v.proposal_id) as lot,
           case when l.state = 'positive' then 'accepted'
                when l.state = 'ignore' or (failures = 1 and missed_by is not null) then 'nearly'
                else 'rejected' end as kind
    from judged v
    join proposals p using (proposal_id)
    left join labels l using (selection_id, proposal_id)
),
ranked as (
    select *,
           row_number() over (partition by selection_id, kind, object order by unseen, lot) as nth,
           row_number() over (partition by selection_id, kind, object
                              order by unseen, kept_by nulls last, proposal_id) as nth_kept,
           row_number() over (partition by selection_id, kind, object
                              order by unseen, missed_by nulls last, proposal_id) as nth_missed
    from candidates
    where kind != 'rejected'
),
turns as (
    -- An object out of the camera's sight waits until those in sight have been shown twice.
    select 'accepted' as shown_as, 1 as shown_place, * exclude (nth, nth_kept, nth_missed),
           nth + 2 * unseen::integer as turn, lot as then_by
    from ranked
    where kind = 'accepted'
    union all
    select 'barely', 2, * exclude (nth, nth_kept, nth_missed), unseen::integer, null
    from ranked
    where kind = 'accepted' and nth_kept = 1 and kept_by is not null
    union all
    select 'nearly', 3, * exclude (nth, nth_kept, nth_missed),
           row_number() over (partition by selection_id, first_failed, state
                              order by unseen, missed_by nulls last, proposal_id), null
    from ranked
    where kind = 'nearly' and nth_missed = 1
    union all
    select 'rejected', 4, * exclude (by_points, by_lot), if(by_points = 1, 1, 2), null
    from (
        select *,
               row_number() over (partition by selection_id, first_failed
                                  order by unseen, number_of_points desc, lot) as by_points,
               row_number() over (partition by selection_id, first_failed
                                  order by unseen, lot) as by_lot
        from candidates
        where kind = 'rejected'
    )
    where by_points = 1 or by_lot = 1
),
taken as (
    select *, row_number() over (
               partition by selection_id, shown_as
               order by turn, then_by, case shown_as when 'barely' then kept_by
                                                     when 'nearly' then missed_by
                                                     else first_failed end nulls last, proposal_id
           ) as place
    from turns
    qualify place <= case shown_as when 'accepted' then getvariable('accepted_shown')
                                   when 'barely' then getvariable('barely_shown')
                                   when 'nearly' then getvariable('nearly_shown')
                                   else getvariable('rejected_shown') end
)
select t.selection_id, t.shown_as as kind, t.place, t.proposal_id, t.state, t.failures,
       t.missed_by, t.kept_by, s.rules[t.decided_by] as deciding_rule, l.score, l.ignored_because,
       p.dataset, p.sequence, p.frame, p.round, p.track_id, p.source, p.fit, p.found,
       p.metric_scale, p.x_m, p.y_m, p.z_m, p.length_m, p.width_m, p.height_m, p.yaw_rad,
       p.left_px, p.top_px, p.right_px, p.bottom_px, p.range_m, p.number_of_points, p.speed_mps,
       p.occluded_share
from taken t
join selections s using (selection_id)
join proposals p using (proposal_id)
left join labels l on l.selection_id = t.selection_id and l.proposal_id = t.proposal_id
order by t.selection_id, t.shown_place, t.place
