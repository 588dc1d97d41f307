-- What stands on a table before a static depth camera, moving or not: connected surfaces above the
-- table's plane, as a box or as what is round from above, completed where something hides a part.
-- rules: source, table_shape, table_age, enough_points, height
-- required: source, table_shape
-- cues: table_clusters
-- next: tabletop_learned
-- loosened: min_table_age_frames = 2, min_points = 15
set variable taken_source = 'table';
set variable taken_fit = '';
set variable min_points = 30;
-- A box on its edge is higher than one that stands.
set variable max_height_m = 8;

-- The more of a thing is seen, the surer.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'outline'
