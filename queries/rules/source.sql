-- The preset decides about proposals of these sources and fits alone; it fails the others.
-- source: section 3.7 cuts regions one way, the released code another, ours a third
-- needs: source and fit are among those taken
-- cues:
set variable taken_source = 'track';  -- source: paper, release, free_space, track, static or table
set variable taken_fit = 'track';  -- fit: min_area, l_shape or track; empty for any
set variable also_taken_source = '';  -- source: a second one; empty for none
set variable also_taken_fit = '';  -- fit: of the second one; empty for any

select p.proposal_id, null::double as value, null::double as bound,
       p.source in (getvariable('taken_source'), getvariable('also_taken_source'))
       and case when p.source = getvariable('taken_source')
                then getvariable('taken_fit') else getvariable('also_taken_fit') end in (p.fit, '')
           as passed
from proposals p
