-- A drive or clip. One row a sequence.
-- weight: light
create table sequences (
    dataset varchar not null,           -- name of the dataset adapter
    sequence varchar not null,          -- drive or clip
    round integer not null,             -- EM round, 1-based
    root varchar not null,              -- where the files lie; paths of frames are relative to it
    sensor varchar not null,            -- lidar or depth
    metric_scale double not null,       -- metres here a metre of a road scene: bounds in metres are multiplied by it
    static_camera boolean not null,     -- the camera is known not to move
    calibration varchar not null,       -- file the calibration came from, or 'generated'
    fingerprint varchar not null,       -- sha256 of calibration text and of names and sizes of the files, labels excluded
    number_of_frames integer not null,  -- frames listed, unreadable ones included
    first_timestamp_ns bigint,          -- UTC
    last_timestamp_ns bigint            -- UTC
);
