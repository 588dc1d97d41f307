-- A labelled object. Read by evaluate alone.
-- weight: light
create table ground_truth (
    dataset varchar not null,        -- name of the dataset adapter
    sequence varchar not null,       -- drive or clip
    frame integer not null,          -- number of the frame
    round integer not null,          -- EM round (always 1)
    object_id varchar not null,      -- the same object in every frame
    category varchar not null,       -- the dataset's own class name; DontCare = a region left out of scoring
    x_m double,                      -- geometric centre, level frame; NULL for DontCare
    y_m double,                      -- geometric centre, level frame
    z_m double,                      -- geometric centre, level frame
    length_m double,                 -- along the heading
    width_m double,                  -- across the heading
    height_m double,                 -- along y
    yaw_rad double,                  -- about y; heading = (cos yaw, 0, -sin yaw)
    level_R_object double[],         -- 9 numbers, row-major: full rotation; columns are the axes length, height (down), width
    object_size_m double[],          -- 3 numbers: the object's own extents along the columns of level_R_object; other than length, height, width where it is tilted (demo, cater)
    left_px double,                  -- 2D box
    top_px double,                   -- 2D box
    right_px double,                 -- 2D box
    bottom_px double,                -- 2D box
    truncated double,                -- as the dataset gives it
    occluded double,                 -- KITTI: 0 to 3; generated: share of hidden pixels
    visible_px integer,              -- generated: visible pixels
    speed_mps double,                -- over the ground, from label positions and the dataset's own poses; NULL without poses
    yaw_observable boolean not null, -- false for what is round from above: its yaw is not scored
    contained_in varchar             -- object_id of what covers it and carries it along; NULL when nothing does
);
