-- The egomotion of the frame returns every point of the sweep to where it was: forward, then
-- backward. It tests consistency, not truth: see the rule alignment.
-- source: eq. 6, 7; 0.25 m in the paper, 0.1 m in the released code
-- needs: value <= max_cycle_error_m * metric_scale
-- cues: odometry, flow_ransac
set variable max_cycle_error_m = 0.25;  -- m: largest displacement of any point of the sweep
set variable egomotion_method = 'odometry';  -- estimator: odometry or flow_ransac

select p.proposal_id, e.cycle_error_m as value,
       (getvariable('max_cycle_error_m') * p.metric_scale)::double as bound,
       value <= bound as passed
from proposals p
left join egomotions e
    on e.dataset = p.dataset and e.sequence = p.sequence and e.frame = p.frame
    and e.round = p.round and e.method = getvariable('egomotion_method')
