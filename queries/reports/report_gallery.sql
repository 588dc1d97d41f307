-- Which candidates the report shows, a few of each kind:
--   accepted: a fair sample, by the md5 of the id, so that nobody picks what looks good;
--   barely: accepted, with the smallest margin to a bound that it had to keep, one an object;
--   nearly: one rule alone keeps it out and by little, or its label says ignore; one an object,
--     each rule in turn;
--   rejected: of the first rule that keeps candidates out, a few by the md5: one of these, and the
--     one of them with the most points.
-- What the camera sees goes before what only the points show. `deciding_rule` is the rule of the
-- smallest margin for what was accepted, the first one that keeps it out for the others.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable accepted_shown = 12;  -- candidates: how many of this kind
set variable barely_shown = 6;     -- candidates: how many of this kind
set variable nearly_shown = 12;    -- candidates: how many of this kind
set variable rejected_shown = 18;  -- candidates: how many of this kind
set variable drawn_a_rule = 32;    -- candidates: looked at for each rule, by md5 or by margin

with judged as materialized (
    select selection_id, proposal_id,
           -- The lowest bit that is set: the first rule in the preset's order.
           case when blocked != 0 then bit_count((blocked & -blocked) - 1) + 1 end as first_failed,
           bit_count(blocked) as failures,
           case when failures = 1 then -margin[first_failed] end as missed_by,
           case when blocked = 0
                then list_min(list_filter(margin, lambda m: m >= 0 and isfinite(m))) end as kept_by,
           case when blocked = 0 then list_position(margin, kept_by) end as kept_at
    from verdicts
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
labelled as (
    select l.selection_id, l.proposal_id, l.state, coalesce(l.track_id, l.proposal_id) as object,
           l.left_px is null as unseen, md5(l.proposal_id) as lot,
           j.first_failed, j.missed_by, j.kept_by, j.kept_at
    from labels l
    join judged j using (selection_id, proposal_id)
),
accepted as (
    -- An object out of the camera's sight waits until those in sight have been shown twice.
    select 'accepted' as kind, 1 as kind_place, selection_id, proposal_id, kept_at as decided_by,
           2 * unseen::integer
               + row_number() over (partition by selection_id, object order by unseen, lot) as turn,
           lot as next
    from labelled
    where state = 'positive'
),
barely as (
    select 'barely' as kind, 2 as kind_place, selection_id, proposal_id, kept_at as decided_by,
           unseen::integer as turn, format('{:020.15f}', kept_by) as next
    from labelled
    where state = 'positive' and kept_by is not null
    qualify row_number() over (partition by selection_id, object
                               order by unseen, kept_by, proposal_id) = 1
),
misses as (
    select selection_id, first_failed, min_by(proposal_id, (missed_by, proposal_id),
                                              getvariable('drawn_a_rule')) as drawn
    from judged
    where failures = 1 and missed_by is not null
    group by all
),
undecided as (
    select selection_id, proposal_id from labelled where state = 'ignore'
    union
    select selection_id, unnest(drawn) from misses
),
nearest as (
    select u.selection_id, u.proposal_id, j.first_failed, j.missed_by, p.left_px is null as unseen,
           l.state is not null as ignored
    from undecided u
    join judged j using (selection_id, proposal_id)
    join proposals p using (proposal_id)
    left join labelled l using (selection_id, proposal_id)
    qualify row_number() over (partition by u.selection_id, coalesce(p.track_id, p.region_id)
                               order by unseen, j.missed_by nulls last, u.proposal_id) = 1
),
nearly as (
    select 'nearly' as kind, 3 as kind_place, selection_id, proposal_id, first_failed as decided_by,
           row_number() over (partition by selection_id, first_failed, ignored
                              order by unseen, missed_by nulls last, proposal_id) as turn,
           format('{:020.15f}', missed_by) as next
    from nearest
),
lots as (
    select selection_id, first_failed, min_by(proposal_id, md5(proposal_id),
                                              getvariable('drawn_a_rule')) as drawn
    from judged
    where failures > 0
    group by all
),
draws as (
    select selection_id, first_failed, unnest(drawn) as proposal_id from lots
),
rejected as (
    select 'rejected' as kind, 4 as kind_place, d.selection_id, d.proposal_id,
           d.first_failed as decided_by,
           row_number() over (partition by d.selection_id, d.first_failed
                              order by p.left_px is null, p.number_of_points desc, d.proposal_id)
               as by_points,
           row_number() over (partition by d.selection_id, d.first_failed
                              order by p.left_px is null, md5(d.proposal_id)) as by_lot,
           if(by_points = 1, 1, 2) as turn, format('{:04}', d.first_failed) as next
    from draws d
    join proposals p using (proposal_id)
    anti join labelled l on l.selection_id = d.selection_id and l.proposal_id = d.proposal_id
    qualify by_points = 1 or by_lot = 1
),
offered as (
    from accepted
    union all by name from barely
    union all by name from nearly
    union all by name from rejected
),
taken as (
    select *, row_number() over (partition by selection_id, kind
                                 order by turn, next nulls last, proposal_id) as place
    from offered
    qualify place <= case kind when 'accepted' then getvariable('accepted_shown')
                               when 'barely' then getvariable('barely_shown')
                               when 'nearly' then getvariable('nearly_shown')
                               else getvariable('rejected_shown') end
)
select t.selection_id, t.kind, t.place, t.proposal_id, l.state, l.score, l.ignored_because,
       s.rules[t.decided_by] as deciding_rule,
       p.dataset, p.sequence, p.frame, p.round, p.track_id, p.source, p.fit, p.found,
       p.metric_scale, p.x_m, p.y_m, p.z_m, p.length_m, p.width_m, p.height_m, p.yaw_rad,
       p.left_px, p.top_px, p.right_px, p.bottom_px, p.range_m, p.number_of_points, p.speed_mps,
       p.occluded_share
from taken t
join selections s using (selection_id)
join proposals p using (proposal_id)
left join labels l on l.selection_id = t.selection_id and l.proposal_id = t.proposal_id
order by t.selection_id, t.kind_place, t.place
