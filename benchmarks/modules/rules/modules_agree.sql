-- Several modules are reasonably sure of the proposal.
-- source: section 3.7: a sum of confidences above a threshold demands that modules agree
-- needs: value >= min_sum_of_confidences
-- cues: tracks
set variable min_sum_of_confidences = 2;  -- sum: of confidences, each in [0, 1]

select p.proposal_id, sum(c.confidence) as value,
       getvariable('min_sum_of_confidences')::double as bound,
       sum(c.confidence) >= getvariable('min_sum_of_confidences') as passed
from proposals p
left join confidences c using (proposal_id)
group by p.proposal_id
