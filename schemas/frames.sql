-- A camera frame. One row a frame, unreadable ones included.
-- weight: light
create table frames (
    dataset varchar not null,          -- name of the dataset adapter
    sequence varchar not null,         -- drive or clip
    frame integer not null,            -- number of the frame, 0-based, as the dataset counts
    round integer not null,            -- EM round, 1-based
    timestamp_ns bigint,               -- UTC
    width_px integer,                  -- image width; NULL without a camera
    height_px integer,                 -- image height; NULL without a camera
    projection double[],               -- 12 numbers, row-major 3x4: camera frame (m) to homogeneous pixels
    camera_T_level double[],           -- 16 numbers, row-major 4x4: level frame to camera frame
    level_T_sensor double[],           -- 16 numbers, row-major 4x4: sensor frame to level frame
    has_image boolean not null,        -- an image can be read
    number_of_points integer,          -- finite points of the sweep or depth image; NULL when it cannot be read
    status varchar not null,           -- ok or error
    error varchar,                     -- what is wrong, where; NULL when nothing is
    image_error varchar                -- why the image cannot be used though the points can; NULL when it can
);
