-- One number a point, one cue, one frame.
-- weight: heavy
create table point_evidence (
    dataset varchar not null,           -- name of the dataset adapter
    sequence varchar not null,          -- drive or clip
    frame integer not null,             -- number of the frame
    round integer not null,             -- EM round
    cue varchar not null,               -- ground, votes_free, votes_static, votes_occluded, motion_3d_m, motion_2d_px, motion_cosine
    number_of_points integer not null,  -- length of the array, in the order of the dataset's points
    codec varchar not null,             -- bits, u8, f16 or f32, zstd-compressed
    data blob not null,                 -- encoded array
    summary double                      -- mean of the finite values (ground: share of ground points)
);
