-- A detected thing that stands is longer than a person: what is as small and stands for seconds is
-- a pole more often than somebody. Abstains on everything else.
-- source: ours: poles that a detector had come to suspect became labels in a third round
-- needs: value >= min_detected_length_m, times metric_scale
-- cues: detected_objects
set variable min_detected_length_m = 2.0;  -- m: length of its box

select p.proposal_id, p.length_m as value,
       (getvariable('min_detected_length_m') * p.metric_scale)::double as bound,
       case when p.source = 'detected' then value >= bound end as passed
from proposals p
