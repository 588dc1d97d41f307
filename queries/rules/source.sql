-- The preset decides about proposals of these sources and fits alone; it fails the others.
-- source: section 3.7 cuts regions one way, the released code another, ours a third
-- needs: source and fit are among those taken
-- cues:
set variable taken_source = 'track';  -- source: paper, release, free_space, track or static
set variable also_taken_source = '';  -- source: a second one; empty for none
set variable taken_fit = 'track';  -- fit: min_area, l_shape or track

select p.proposal_id, null::double as value, null::double as bound,
       p.source in (getvariable('taken_source'), getvariable('also_taken_source'))
       and p.fit = getvariable('taken_fit') as passed
from proposals p
