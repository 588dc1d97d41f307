-- The sequences in which tracking can be scored: those with labelled objects.
select distinct dataset, sequence
from ground_truth
where category != 'DontCare'
order by dataset, sequence
