-- How modules agree: of the proposals that two modules speak of, how many both are sure of, only one,
-- none. agreement is the share on which they say the same; lift above 1 says that they are sure
-- together more often than chance would have it, below 1 that they contradict each other.
-- The row of a module with itself (other is NULL) says what it covers: asked counts the proposals
-- that it looked at, both_speak those of which it had evidence.
set variable sure_confidence = 0.5;  -- confidence in [0, 1]: from here on a module is sure

with modules as materialized (
    select coalesce(source, '') as source, module, count(*) as asked, count(confidence) as spoken,
           count(*) filter (confidence >= getvariable('sure_confidence')) as sure
    from confidences
    group by all
),
numbered as (
    select module, 1::bigint << (row_number() over (order by module) - 1) as bit
    from (select distinct module from modules)
),
-- Only where several modules speak of a source are there pairs: the rest need not be grouped by id.
shared as (
    select source from modules where spoken > 0 group by source having count(*) > 1
),
said as (
    select proposal_id, bit_or(bit) as spoke,
           bit_or(if(confidence >= getvariable('sure_confidence'), bit, 0)) as sure
    from confidences
    join numbered using (module)
    where confidence is not null and coalesce(source, '') in (from shared)
    group by proposal_id
),
patterns as (
    select spoke, sure, count(*) as proposals from said group by all
),
paired as (
    select a.module, b.module as other, null::bigint as asked,
           sum(proposals)::bigint as both_speak,
           coalesce(sum(proposals) filter (sure & a.bit <> 0 and sure & b.bit <> 0), 0)::bigint
               as both_sure,
           coalesce(sum(proposals) filter (sure & a.bit <> 0 and sure & b.bit = 0), 0)::bigint
               as only_module_sure,
           coalesce(sum(proposals) filter (sure & a.bit = 0 and sure & b.bit <> 0), 0)::bigint
               as only_other_sure
    from numbered a
    join numbered b on a.module < b.module
    join patterns on spoke & a.bit <> 0 and spoke & b.bit <> 0
    group by all
    union all
    select module, null, sum(asked)::bigint, sum(spoken)::bigint, sum(sure)::bigint, 0, 0
    from modules
    group by module
)
select *, both_speak - both_sure - only_module_sure - only_other_sure as none_sure,
       if(other is null, null, (both_sure + none_sure) / both_speak) as agreement,
       if(other is null, null,
          both_sure * both_speak
              / nullif((both_sure + only_module_sure) * (both_sure + only_other_sure), 0)) as lift
from paired
order by other is not null, module, other
