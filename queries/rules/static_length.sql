-- A thing that never moved has the length of a vehicle; the bound shown is the nearer. Abstains on
-- everything else.
-- source: ours
-- needs: min_static_length_m <= value <= max_static_length_m, times metric_scale
-- cues: static_clusters
set variable min_static_length_m = 2.8;  -- m: smallest length of a vehicle
set variable max_static_length_m = 6.0;  -- m: largest length of a vehicle

select p.proposal_id, p.length_m as value,
       (case when value < p.metric_scale
                  * (getvariable('min_static_length_m') + getvariable('max_static_length_m')) / 2
             then getvariable('min_static_length_m') else getvariable('max_static_length_m') end
        * p.metric_scale)::double as bound,
       case when p.source = 'static'
            then value between getvariable('min_static_length_m') * p.metric_scale
                               and getvariable('max_static_length_m') * p.metric_scale end as passed
from proposals p
