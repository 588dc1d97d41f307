-- What became of a proposal in every selection, and of its relations in the one asked about: other
-- proposals of its region, of its track in other frames, and of its place (the centre of one lies in
-- the box of the other). outcome: positive or ignore (a label), rejected (rules in stopped_by keep it
-- from being one), or left out (every rule lets it pass and the preset's select does not take it).
set variable selection_id = null::varchar;  -- which selection's relations; NULL = of every one
set variable proposal_id = null::varchar;   -- which proposal; NULL = none

with asked as (
    select * from proposals where proposal_id = getvariable('proposal_id')
),
related as (
    select p.proposal_id, p.source, p.fit, p.frame, abs(p.frame - a.frame) as frames_away,
           case when p.proposal_id = a.proposal_id then 'itself'
                when p.frame <> a.frame then 'same track'
                when p.region_id = a.region_id then 'same region'
                else 'same place' end as relation
    from proposals p
    join asked a on a.dataset = p.dataset and a.sequence = p.sequence and a.round = p.round
    where p.track_id = a.track_id
       or p.frame = a.frame
          and (p.region_id = a.region_id
               or abs((p.x_m - a.x_m) * cos(a.yaw_rad) - (p.z_m - a.z_m) * sin(a.yaw_rad))
                      <= a.length_m / 2
                  and abs((p.x_m - a.x_m) * sin(a.yaw_rad) + (p.z_m - a.z_m) * cos(a.yaw_rad))
                      <= a.width_m / 2
               or abs((a.x_m - p.x_m) * cos(p.yaw_rad) - (a.z_m - p.z_m) * sin(p.yaw_rad))
                      <= p.length_m / 2
                  and abs((a.x_m - p.x_m) * sin(p.yaw_rad) + (a.z_m - p.z_m) * cos(p.yaw_rad))
                      <= p.width_m / 2)
),
listed as (
    select selection_id, unnest(rules) as rule, unnest(required) as required,
           generate_subscripts(rules, 1) as place
    from selections
),
judged as (
    select c.selection_id, any_value(c.selection) as selection, r.proposal_id, r.source, r.fit, r.frame,
           r.frames_away, r.relation,
           coalesce(list(c.rule order by n.place)
                    filter (coalesce(not c.passed, n.required)), []) as stopped_by
    from checks c
    join related r on r.proposal_id = c.proposal_id
    join listed n on n.selection_id = c.selection_id and n.rule = c.rule
    where r.relation = 'itself' or getvariable('selection_id') is null
          or c.selection_id = getvariable('selection_id')
    group by all
),
settled as (
    select j.*, l.score, l.ignored_because,
           case when l.state is not null then l.state
                when j.stopped_by <> [] then 'rejected' else 'left out' end as outcome
    from judged j
    left join labels l on l.selection_id = j.selection_id and l.proposal_id = j.proposal_id
),
counted as (
    select relation, selection_id, selection, source, fit, outcome, ignored_because,
           if(outcome = 'positive', [], stopped_by) as stopped_by, count(*) as proposals,
           min(frame) as first_frame, max(frame) as last_frame,
           arg_min(proposal_id, (frames_away, proposal_id)) as proposal_id, max(score) as score
    from settled
    group by all
)
select *
from counted
order by relation <> 'itself', selection_id <> getvariable('selection_id'), selection, selection_id,
         relation, proposals desc, proposal_id
