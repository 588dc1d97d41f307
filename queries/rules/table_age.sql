-- A thing on a table shows in several frames: what flickers at the edge of another is none. Abstains
-- on everything else.
-- source: ours
-- needs: value >= min_table_age_frames
-- cues: table_clusters
set variable min_table_age_frames = 3;  -- frames: in which it was seen

select p.proposal_id, p.age_frames::double as value,
       getvariable('min_table_age_frames')::double as bound,
       case when p.source = 'table' then value >= bound end as passed
from proposals p
