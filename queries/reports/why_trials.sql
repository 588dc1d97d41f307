-- Which parameter of a rule, and which value of it, would let the rule pass a proposal: of the trials
-- that passed the one with what the rule measured before one with another column of the proposal, then
-- with few digits, then nearest to the present value.
-- SQL of the trials, a row each: parameter, text and tried_value of the value, its present value, place
-- (1 = measured by the rule, 2 = another column), few_digits, and whether the rule passed.
set variable trials = 'select ''min_points'' as parameter, ''8'' as text, 8.0 as tried_value, 10.0 as present, 1 as place, true as few_digits, false as passed';  -- SQL: a rule's trials

select parameter, text
from query(getvariable('trials'))
where passed
order by place, not few_digits, abs(tried_value - present) / greatest(abs(present), 1e-9),
         parameter, text
limit 1
