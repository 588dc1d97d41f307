-- Several modules are reasonably sure of the proposal.
-- source: section 3.7: a sum of confidences above a threshold demands that modules agree
-- needs: value >= min_sum_of_confidences
-- cues: tracks
set variable min_sum_of_confidences = 2;  -- sum: of confidences, each in [0, 1]

with said as (
    select proposal_id, sum(confidence) as total from confidences group by proposal_id
)
select p.proposal_id, s.total as value, getvariable('min_sum_of_confidences')::double as bound,
       value >= bound as passed
from proposals p
left join said s on s.proposal_id = p.proposal_id
