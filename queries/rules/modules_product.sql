-- All modules of appearance are nearly sure: the product of 3D and, where there is an image, 2D
-- objectness. Abstains where the detector does not speak.
-- source: the released code multiplies where the paper adds
-- needs: value > min_product
-- cues: objectness3d, objectness2d
set variable min_product = 0.9;  -- probability: of the product

with said as (
    select proposal_id,
           max(confidence) filter (module = 'objectness_3d') as objectness_3d,
           max(confidence) filter (module = 'objectness_2d') as objectness_2d
    from confidences
    group by proposal_id
)
select p.proposal_id, s.objectness_3d * coalesce(s.objectness_2d, 1) as value,
       getvariable('min_product')::double as bound, value > bound as passed
from proposals p
left join said s on s.proposal_id = p.proposal_id
