-- Something moved there: the surest of the modules that measure motion, else the share of the points
-- that was not there in other sweeps.
-- source: the released code: each label overlaps a component of motion
-- needs: value >= min_motion
-- cues: regions_paper, regions_release, regions_free_space, tracks, objectness3d, visibility
set variable min_motion = 0.5;  -- probability: that it moved

with said as (
    select proposal_id,
           max(confidence) filter (module in ('motion_3d', 'motion_2d', 'free_space', 'track'))
               as motion
    from confidences
    group by proposal_id
)
select p.proposal_id, coalesce(s.motion, p.core_share) as value,
       getvariable('min_motion')::double as bound, value >= bound as passed
from proposals p
left join said s on s.proposal_id = p.proposal_id
