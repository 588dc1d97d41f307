-- What stands on a table before a static depth camera, moving or not: connected surfaces above the
-- table's plane, as a box or as what is round from above, completed where something hides a part.
-- rules: source, table_shape, table_age, enough_points, height, not_overlapped
-- required: source, table_shape
-- cues: table_clusters
-- loosened: min_table_age_frames = 2, min_points = 15, max_overlapped_share = 0.7
set variable taken_source = 'table_box';
set variable taken_fit = 'min_area';
set variable also_taken_source = 'table_round';
set variable also_taken_fit = 'round';
set variable min_points = 30;
-- A box on its edge is higher than one that stands.
set variable max_height_m = 8;
set variable sure_points = 500;  -- points: with as many and more, a thing is as sure as can be

-- The more of a thing is seen, the surer.
select p.proposal_id, 'positive' as state,
       (least(p.track_points / getvariable('sure_points'), 1) * coalesce(c.confidence, 0))::double
           as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'outline'
