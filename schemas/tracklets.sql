-- An object followed over time, one row a frame, as tracking from a selection's labels found it.
-- weight: light
create table tracklets (
    tracklet_id varchar not null,    -- dataset/sequence/tracklet-selection/number: the same in every frame
    selection_id varchar not null,   -- selections.selection_id: whose labels were followed
    dataset varchar not null,        -- name of the dataset adapter
    sequence varchar not null,       -- drive or clip
    frame integer not null,          -- number of the frame
    round integer not null,          -- EM round of the labels
    library boolean not null,        -- whether the library of trajectories was used
    tracker varchar not null,        -- nearest, correlation or auto
    found varchar not null,          -- nearest, correlation; out of sight: library, container (rides inside another object) or interpolated
    proposal_id varchar,             -- proposals.proposal_id of the label whose box was taken
    x_m double not null,             -- geometric centre, level frame
    y_m double not null,             -- geometric centre, level frame
    z_m double not null,             -- geometric centre, level frame
    length_m double not null,        -- along the heading
    width_m double not null,         -- across the heading
    height_m double not null,        -- along y
    yaw_rad double not null,         -- about y; heading = (cos yaw, 0, -sin yaw)
    left_px double,                  -- 2D box, clipped to the image; NULL without a camera or outside of its view
    top_px double,                   -- clipped to the image
    right_px double,                 -- clipped to the image
    bottom_px double,                -- clipped to the image
    center_u_px double,              -- projection of the 3D centre
    center_v_px double,              -- projection of the 3D centre
    truncated_share double,          -- share of the unclipped 2D box outside the image
    frames_from_sighting integer not null,  -- distance to the nearest frame in which it was matched; 0 = this one
    visible_share double not null,   -- share of rays to the box that nothing stops before it
    score double,                    -- of the match, in [0, 1]; NULL out of sight
    number_of_points integer not null,  -- points in the box, without the ground
    passable double not null,        -- p at the centre (eq. 9); out of sight its mean along the path
    speed_mps double                 -- over the ground; NULL without timestamps and in its first frame
);
