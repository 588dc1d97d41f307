-- The preset decides about proposals of these sources and fits alone; it fails the others.
-- source: section 3.7 cuts regions one way, the released code another, ours a third
-- needs: source and fit are among those taken
-- cues:
set variable taken_source = 'track';  -- source: paper, release, free_space, track, static, table or detected
set variable taken_fit = 'track';  -- fit: min_area, l_shape, track or persistent; empty for any
set variable also_taken_source = '';  -- source: others, with commas between; empty for none
set variable also_taken_fit = '';  -- fit: of each of the others, in their order; empty for any

select p.proposal_id, null::double as value, null::double as bound,
       list_contains(
           list_zip([getvariable('taken_source')] || string_split(getvariable('also_taken_source'), ','),
                    [getvariable('taken_fit')] || string_split(getvariable('also_taken_fit'), ',')),
           row(p.source, p.fit))
       or list_contains(
           list_zip([getvariable('taken_source')] || string_split(getvariable('also_taken_source'), ','),
                    [getvariable('taken_fit')] || string_split(getvariable('also_taken_fit'), ',')),
           row(p.source, '')) as passed
from proposals p
