-- The motion inside the region differs from the motion in the shell around it.
-- source: eq. 10: chi-square distance of the histograms of |dXYZ|
-- needs: value >= min_center_surround_chi2
-- cues: regions_paper
set variable min_center_surround_chi2 = 0.5;  -- chi-square: 0 = alike; the paper gives no number

select p.proposal_id, p.center_surround_chi2 as value,
       getvariable('min_center_surround_chi2')::double as bound,
       value >= bound as passed
from proposals p
