-- A thing that never moved has the height of a vehicle; the bound shown is the nearer. Abstains on
-- everything else.
-- source: ours
-- needs: min_static_height_m <= value <= max_static_height_m, times metric_scale
-- cues: static_clusters
set variable min_static_height_m = 1.2;  -- m: smallest height of a vehicle
set variable max_static_height_m = 2.5;  -- m: largest height of a vehicle

select p.proposal_id, coalesce(p.track_height_m, p.height_m) as value,
       (case when value < p.metric_scale
                  * (getvariable('min_static_height_m') + getvariable('max_static_height_m')) / 2
             then getvariable('min_static_height_m') else getvariable('max_static_height_m') end
        * p.metric_scale)::double as bound,
       case when p.source = 'static'
            then value between getvariable('min_static_height_m') * p.metric_scale
                               and getvariable('max_static_height_m') * p.metric_scale end as passed
from proposals p
