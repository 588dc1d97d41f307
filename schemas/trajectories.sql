-- A path that a tracklet took, normalised to its start: what the library is chosen from. Ungated.
-- weight: light
create table trajectories (
    trajectory_id varchar not null,  -- tracklet_id/first frame
    tracklet_id varchar not null,    -- tracklets.tracklet_id
    selection_id varchar not null,   -- selections.selection_id: whose labels were followed
    dataset varchar not null,        -- name of the dataset adapter
    sequence varchar not null,       -- drive or clip
    frame integer not null,          -- number of its first frame
    round integer not null,          -- EM round
    frames integer not null,         -- frames from its first to its last
    metric_scale double not null,    -- copied from sequences: bounds in metres are multiplied by it
    first_step_m double not null,    -- metres a frame of the first motion (3 frames)
    travel_m double not null,        -- distance between its ends, over the ground
    passable double not null,        -- mean p along the path (eq. 9)
    lowest_passable double not null, -- smallest p along the path
    visible_share double not null,   -- mean over the path
    flow_error_px double,            -- median distance of the 2D flow in the box from the projected 3D motion; NULL without flows
    along_m double[] not null,       -- displacement along the first motion after 1, 2, ... frames
    down_m double[] not null,        -- the same, down
    across_m double[] not null,      -- the same, across the first motion
    turn_rad double[] not null       -- yaw relative to the start
);
