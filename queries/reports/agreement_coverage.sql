-- What each module speaks of: coverage is the share of all proposals for which it has a confidence,
-- of_sources the same of the proposals of the sources it looks at; sure counts those it is sure of.
set variable sure_confidence = 0.5;  -- confidence in [0, 1]: from here on a module is sure

with sources as (
    select source, count(*) as proposals from proposals group by all
),
spoken as (
    select module, coalesce(source, '') as source, count(confidence) as spoken,
           count(*) filter (confidence >= getvariable('sure_confidence')) as sure
    from confidences
    group by all
)
select module, sum(spoken)::bigint as spoken, sum(sure)::bigint as sure,
       sum(spoken) / (select sum(proposals) from sources) as coverage,
       sum(spoken) / nullif(sum(proposals), 0) as of_sources, sum(sure) / nullif(sum(spoken), 0) as sure_share
from spoken
left join sources using (source)
group by module
order by module
