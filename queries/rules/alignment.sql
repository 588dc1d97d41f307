-- The chained egomotion lays the frame's points on the surfaces seen some frames later: unlike the
-- cycle error this catches an estimator that is consistently wrong. Abstains at the last frames.
-- source: ours: on a slow drive flow RANSAC passes every cycle check and is wrong by 4 times.
--   Measured: right motion leaves 0.7 on a street at 3 m/s and 0.5 at 20 m/s, motion wrong by a
--   tenth 0.2
-- needs: value >= min_alignment_share
-- cues: odometry, flow_ransac
set variable min_alignment_share = 0.3;  -- share: of the points that find a neighbour
set variable alignment_method = 'odometry';  -- estimator: odometry or flow_ransac
set variable min_alignment_frames = 5;  -- frames: a shorter look ahead says little: abstains

select p.proposal_id, e.alignment_share as value,
       getvariable('min_alignment_share')::double as bound,
       case when e.alignment_frames >= getvariable('min_alignment_frames')
            then value >= bound end as passed
from proposals p
left join egomotions e
    on e.dataset = p.dataset and e.sequence = p.sequence and e.frame = p.frame
    and e.round = p.round and e.method = getvariable('alignment_method')
