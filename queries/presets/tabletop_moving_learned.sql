-- A table on which what moved was learnt from: of the things that rise above its plane those that
-- moved and those that the detector takes for objects. The rest is left undecided.
-- rules: source, table_shape, table_age, enough_points, height, table_witness
-- required: source, table_shape, table_witness
-- cues: table_clusters, table_motion, objectness3d
-- ignore: tabletop
-- loosened: min_table_age_frames = 2, min_points = 15, min_witness = 0.1
set variable taken_source = 'table';
set variable taken_fit = '';
set variable min_points = 30;
-- A detector that was taught by what moved is less sure of what it has not seen the like of.
set variable min_witness = 0.2;
-- A box on its edge is higher than one that stands.
set variable max_height_m = 8;

-- The more of a thing is seen, the surer.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, 0)::double as score
from proposals p
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'outline'
