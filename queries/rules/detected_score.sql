-- In its best frames the detector is sure of it. Of a large thing that it finds in most of the
-- frames that show its place, less is asked: what stands in the very drive that the detector learnt
-- from was background to it. Abstains on everything else.
-- source: ours: far and hidden objects are faint for most of a drive, and sure when near
-- needs: value >= min_best_half_score, or min_steady_score when found steadily
-- cues: detected_objects
set variable min_best_half_score = 0.5;  -- probability: mean over the surer half of its detections
set variable min_steady_score = 0.2;  -- probability: the same, of a large thing found steadily
set variable min_steady_share = 0.5;  -- share: of the frames that show its place, to be found steadily
set variable min_steady_age_frames = 8;  -- frames: it was detected in, to be found steadily
set variable min_steady_length_m = 2.8;  -- m: length of its box; poles and bushes are found steadily too

select p.proposal_id, p.best_half_score as value,
       (case when p.visible_share >= getvariable('min_steady_share')
                  and p.age_frames >= getvariable('min_steady_age_frames')
                  and p.length_m >= getvariable('min_steady_length_m') * p.metric_scale
             then getvariable('min_steady_score')
             else getvariable('min_best_half_score') end)::double as bound,
       case when p.source = 'detected' then value >= bound end as passed
from proposals p
