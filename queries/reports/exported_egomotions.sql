-- Which sequences of an export have a global frame: those of a camera that does not move, and those with egomotion that links frames.
set variable exported_dataset = null::varchar;  -- which dataset; NULL = all

with moved as (
    select dataset, sequence, count(*) as motions
    from egomotions
    where round = 1 and "to_T_from" is not null
    group by all
)
select f.dataset, f.sequence, count(*) as frames,
       bool_or(s.static_camera) or coalesce(any_value(m.motions), 0) > 0 as linked
from frames f
join sequences s on (s.dataset, s.sequence, s.round) = (f.dataset, f.sequence, 1)
left join moved m on (m.dataset, m.sequence) = (f.dataset, f.sequence)
where f.round = 1 and f.status = 'ok'
  and (getvariable('exported_dataset') is null or f.dataset = getvariable('exported_dataset'))
group by f.dataset, f.sequence
order by f.dataset, f.sequence
