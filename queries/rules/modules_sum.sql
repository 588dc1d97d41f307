-- The modules that speak of it (motion, 3D objectness, 2D objectness) are together so sure that no
-- fewer of them could be, or one alone is exceedingly sure. Motion is the surest of those that
-- measure it; of a detection, the share of its points that was not there in other sweeps.
-- source: section 3.7: a sum of three above 2; promotion by one module
-- needs: value > number of modules - 1, or one confidence above exceedingly_sure
-- cues: objectness3d, objectness2d, visibility
set variable exceedingly_sure = 0.95;  -- probability: above it a module needs no other
set variable fewest_modules = 2;  -- modules: with fewer it abstains

with said as (
    select proposal_id,
           max(confidence) filter (module in ('motion_3d', 'free_space', 'track')) as motion,
           max(confidence) filter (module = 'objectness_3d') as objectness_3d,
           max(confidence) filter (module = 'objectness_2d') as objectness_2d
    from confidences
    group by proposal_id
)
select p.proposal_id,
       list_sum([coalesce(s.motion, p.core_share), s.objectness_3d, s.objectness_2d])::double as value,
       (list_count([coalesce(s.motion, p.core_share), s.objectness_3d, s.objectness_2d]) - 1)::double
           as bound,
       case when bound + 1 >= getvariable('fewest_modules')
            then value > bound
                 or coalesce(greatest(s.objectness_3d, s.objectness_2d)
                             > getvariable('exceedingly_sure'), false) end as passed
from proposals p
left join said s on s.proposal_id = p.proposal_id
