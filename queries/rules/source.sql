-- The preset decides about proposals of these sources and fits alone; it fails the others.
-- source: section 3.7 cuts regions one way, the released code another, ours a third
-- needs: source and fit are among those taken
-- cues:
set variable taken_sources = 'track';  -- words apart: paper, release, free_space, track, static
set variable taken_fits = 'track min_area l_shape';  -- words apart: min_area, l_shape, track

select p.proposal_id, null::double as value, null::double as bound,
       list_contains(string_split(getvariable('taken_sources'), ' '), p.source)
       and list_contains(string_split(getvariable('taken_fits'), ' '), p.fit) as passed
from proposals p
