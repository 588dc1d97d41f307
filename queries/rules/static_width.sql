-- A thing that never moved has the width of a vehicle; the bound shown is the nearer. Abstains on
-- everything else.
-- source: ours
-- needs: min_static_width_m <= value <= max_static_width_m, times metric_scale
-- cues: static_clusters
set variable min_static_width_m = 1.0;  -- m: smallest width of a vehicle
set variable max_static_width_m = 2.3;  -- m: largest width of a vehicle

select p.proposal_id, p.width_m as value,
       (case when value < p.metric_scale
                  * (getvariable('min_static_width_m') + getvariable('max_static_width_m')) / 2
             then getvariable('min_static_width_m') else getvariable('max_static_width_m') end
        * p.metric_scale)::double as bound,
       case when p.source = 'static'
            then value between getvariable('min_static_width_m') * p.metric_scale
                               and getvariable('max_static_width_m') * p.metric_scale end as passed
from proposals p
