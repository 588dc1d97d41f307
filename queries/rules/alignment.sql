-- The chained egomotion lays the frame's points on the surfaces seen some frames later: unlike the
-- cycle error this catches an estimator that is consistently wrong. The last frames take the last
-- look, which reached as far as they are. Abstains where no look was long enough.
-- source: ours: on a slow drive flow RANSAC passes every cycle check and is wrong by 4 times.
--   Measured: right motion leaves 0.7 at 3 m/s, 0.5 at 20 m/s, 0.27 at 30 m/s; at 3 m/s motion wrong
--   by a tenth leaves 0.2 and by a fifth 0.1
-- needs: value >= min_alignment_share
-- cues: odometry, flow_ransac
set variable min_alignment_share = 0.2;  -- share: of the points that find a neighbour
set variable alignment_method = 'odometry';  -- estimator: odometry or flow_ransac
set variable min_alignment_frames = 5;  -- frames: a shorter look ahead says little

select p.proposal_id, e.alignment_share as value,
       getvariable('min_alignment_share')::double as bound, value >= bound as passed
from proposals p
asof left join (
    select dataset, sequence, round, frame, alignment_share
    from egomotions
    where method = getvariable('alignment_method')
      and alignment_frames >= getvariable('min_alignment_frames')
) e
    on e.dataset = p.dataset and e.sequence = p.sequence and e.round = p.round
    and p.frame >= e.frame
