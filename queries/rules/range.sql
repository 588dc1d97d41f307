-- The object is not so near that it is the ego vehicle itself.
-- source: ours: range > 4 m
-- needs: value > min_range_m * metric_scale
-- cues:
set variable min_range_m = 4;  -- m: horizontal distance from the sensor to the box's centre

select p.proposal_id, p.range_m as value,
       (getvariable('min_range_m') * p.metric_scale)::double as bound,
       value > bound as passed
from proposals p
