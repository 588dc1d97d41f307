-- Of the two boxes of a thing on a table, the one that fits its shape: points that fill their
-- smallest rectangle from above are a box's, others are round. Abstains on everything else.
-- source: ours: a circle fills 0.79 of its square; the half of a ball that a camera sees, less
-- needs: value >= min_box_fill_share where fit is min_area, value < min_box_fill_share where it is round
-- cues: table_clusters
set variable min_box_fill_share = 0.85;  -- share: hull over rectangle; median where nothing hides it

select p.proposal_id, p.track_fill_share as value,
       getvariable('min_box_fill_share')::double as bound,
       case when p.source = 'table'
            then if(p.fit = 'round', value < bound, value >= bound) end as passed
from proposals p
