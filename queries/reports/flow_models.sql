-- Which flow network is in use: a finetuned one replaces its teacher only when, on pairs that it did
-- not learn from, more of its flow is cycle-consistent and the images agree at least as well. One
-- that went on learning from generated pairs stands in for the one that it began with. Who comes
-- after a rejected or unchecked one is in use no more than that one: it was never compared with what
-- is. One whose teacher is in another store was brought from there, and is taken as it is.
set variable min_consistent_gain = 0.0;    -- share: by which the student's consistent share must exceed the teacher's
set variable max_photometric_ratio = 1.0;  -- ratio: of the student's photometric error to the teacher's, at most
set variable min_held_out_pairs = 1;       -- pairs: that both were measured on, at least

-- Sums of decimals are the same in any order, those of doubles are not.
with recursive measured as (
    select model_id, role, any_value(measured_id) as measured_id, count(*) as pairs,
           sum(consistent_share::decimal(18, 12))::double / count(*) as consistent_share,
           sum(photometric_error::decimal(18, 12))::double / count(photometric_error)
               as photometric_error
    from flow_checks
    group by all
),
judged as (
    select s.model_id, t.measured_id as teacher_id, s.pairs,
           s.consistent_share, t.consistent_share as teacher_consistent_share,
           s.photometric_error, t.photometric_error as teacher_photometric_error,
           s.pairs >= getvariable('min_held_out_pairs') and s.pairs = t.pairs
           and s.consistent_share - t.consistent_share > getvariable('min_consistent_gain')
           -- No pixel that ends inside the image: nothing says that the images agree.
           and coalesce(s.photometric_error
                        <= t.photometric_error * getvariable('max_photometric_ratio'), false)
               as promoted
    from measured s
    join measured t on t.model_id = s.model_id and t.role = 'teacher'
    where s.role = 'student'
),
stated as (
    select m.model_id, m.network, m.settings, m.step, m.steps, m.finished,
           m.settings ->> '$.teacher' as teacher_id, m.settings ->> '$.start' as start_id,
           j.* exclude (model_id, teacher_id),
           case when m.settings ->> '$.teacher' is null then 'origin'
                when m.settings ->> '$.teacher' not in (select model_id from models) then 'brought'
                when j.promoted is null then 'unchecked'
                when j.promoted then 'promoted'
                else 'rejected' end as state
    from models m
    left join judged j using (model_id)
    where m.kind = 'flow'
),
barred as (
    select model_id from stated where state in ('rejected', 'unchecked')
    union
    select s.model_id from stated s
    join barred b on b.model_id in (s.teacher_id, s.start_id)
),
admitted as (
    select model_id, coalesce(teacher_id, start_id) as follows_id from stated
    where finished and model_id not in (select model_id from barred)
)
select * exclude (promoted, start_id),
       model_id in (select model_id from admitted)
       and model_id not in (select follows_id from admitted where follows_id is not null) as in_use
from stated
order by model_id
