-- The object is as high as something on a road: no kerb, no facade. The bound shown is the nearer.
-- source: ours
-- needs: min_height_m <= value <= max_height_m, times metric_scale
-- cues:
set variable min_height_m = 0.4;  -- m: height of the track's box, else of the box
set variable max_height_m = 4.5;  -- m: height of the track's box, else of the box

select p.proposal_id, coalesce(p.track_height_m, p.height_m) as value,
       (case when value < p.metric_scale
                  * (getvariable('min_height_m') + getvariable('max_height_m')) / 2
             then getvariable('min_height_m') else getvariable('max_height_m') end
        * p.metric_scale)::double as bound,
       value between getvariable('min_height_m') * p.metric_scale
                      and getvariable('max_height_m') * p.metric_scale as passed
from proposals p
