-- A candidate object in one frame, with every number that a rule could want. Nothing is gated:
-- what no rule would accept stays here. Columns that a source cannot measure are NULL.
-- weight: light
create table proposals (
    proposal_id varchar not null,       -- dataset/sequence/frame/source/number/fit, the same on every run
    dataset varchar not null,           -- name of the dataset adapter
    sequence varchar not null,          -- drive or clip
    frame integer not null,             -- number of the frame
    round integer not null,             -- EM round
    source varchar not null,            -- paper, release, free_space, detector (one frame), track, static, detected, table, tracklet (many frames)
    fit varchar not null,               -- how the box was fitted: min_area, l_shape, track, center_net, persistent, tracklet or round (no yaw: it cannot be observed)
    region_id varchar not null,         -- the region it was fitted to; two fits of one region share it
    track_id varchar,                   -- tracks and static objects: the same in every frame
    found varchar not null,             -- observed, gap (between two sightings), extended (beyond the first or last)
    metric_scale double not null,       -- copied from sequences: bounds in metres are multiplied by it
    -- the 3D box, level frame: x right, y down, z forward
    x_m double not null,                -- geometric centre
    y_m double not null,                -- geometric centre
    z_m double not null,                -- geometric centre
    length_m double not null,           -- along the heading
    width_m double not null,            -- across the heading
    height_m double not null,           -- along y
    yaw_rad double not null,            -- about y; heading = (cos yaw, 0, -sin yaw)
    yaw_observable boolean,             -- false where the box is of what is round from above: its yaw means nothing; NULL where nobody asked
    -- the 2D box, pixels; NULL without a camera or when behind it
    left_px double,                     -- clipped to the image
    top_px double,                      -- clipped to the image
    right_px double,                    -- clipped to the image
    bottom_px double,                   -- clipped to the image
    center_u_px double,                 -- projection of the 3D centre, not clipped
    center_v_px double,                 -- projection of the 3D centre, not clipped
    truncated_share double,             -- share of the unclipped 2D box that lies outside the image
    occluded_share double,              -- share of the box's visible outline with a nearer return in front
    -- the points
    range_m double not null,            -- horizontal distance from the sensor to the centre
    number_of_points integer not null,  -- points of the region; for filled boxes the points inside the box
    point_indices integer[],            -- indices into the frame's points
    mask varchar,                       -- COCO run-length string of the region's pixels (height x width of the frame)
    bottom_above_ground_m double,       -- lowest point above the ground
    top_above_ground_m double,          -- highest point above the ground
    -- free space over many sweeps
    core_points integer,                -- points with votes_free >= 2 and votes_free > votes_static
    core_share double,                  -- core_points / number_of_points
    votes_free_mean double,             -- mean over the points: sweeps that saw through the place
    votes_static_mean double,           -- mean over the points: sweeps that saw the same surface there
    free_share double,                  -- share of the points with votes_free > votes_static
    -- motion with the egomotion taken out
    motion_threshold_m double,          -- paper: the |dXYZ| level at which the region was cut out
    motion_threshold_next_m double,     -- paper: the next higher level of the build; NULL at its highest
    motion_3d_m double,                 -- median |dXYZ| of the points
    motion_2d_px double,                -- median |flow - egomotion flow| of the points
    motion_cosine double,               -- median cos(flow, egomotion flow) of the points
    center_surround_chi2 double,        -- chi-square distance of |dXYZ| inside and in the shell around (eq. 10)
    voxels_a integer,                   -- release: voxels of 0.125 m with cos < 0.8
    voxels_b integer,                   -- release: voxels with |flow - egomotion flow| > 8 px
    smallest_side_voxels integer,       -- release: smallest side of the component, voxels
    smallest_side_px double,            -- release: smaller side of the projected region, pixels
    projected_px integer,               -- release: pixels that the centres of the voxels of A and B project to
    size_rank integer,                  -- release: rank of the region in its frame by voxels, 1 = largest
    -- shape
    fill_share double,                  -- hull area over rectangle area, from above
    edge_share double,                  -- share of the points within 0.3 m * metric_scale of a side of the box, from above
    fit_residual_m double,              -- mean distance of the points to the nearest side, from above
    -- the track it belongs to, the same in each of its rows
    age_frames integer,                 -- frames in which the track was observed
    span_frames integer,                -- last observed frame - first + 1
    travel_m double,                    -- distance between the ends of the smoothed path, over the ground
    path_length_m double,               -- length of the smoothed path
    straightness double,                -- travel_m / path_length_m
    speed_mps double,                   -- speed at this frame; NULL without timestamps
    at_clip_edge boolean,               -- the track was observed in the first or the last frame
    track_core_share double,            -- median core_share over the track
    track_box_core_share double,        -- tracks: median over the observed frames of the core share of all points in the box but ground; 0 when empty
    track_points double,                -- median number of points over the track
    track_fill_share double,            -- table: median fill_share of the sightings around that nothing hides
    track_height_m double,              -- height of the track's box
    track_range_min_m double,           -- nearest it came
    seen_length_m double,               -- tracks: the length that its points show; length_m is more where a vehicle's proportions fill in
    seen_width_m double,                -- tracks: the width that its points show; width_m is more where a vehicle's proportions fill in
    refinement_residual_m double,       -- root mean square change of the anchors under smoothing
    visible_frames integer,             -- detected: frames that show its place, not hidden and in the detector's reach
    visible_share double,               -- detected: age_frames / visible_frames
    best_half_score double,             -- detected: mean of the surer half of its detections' scores
    frames_from_observation integer,    -- distance to the nearest observed frame (0 = observed)
    overlapped_share double             -- largest share of the footprint that a surer track covers in the same frame
);
