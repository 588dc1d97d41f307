-- Optical flow of a frame pair, one direction, one estimator. Ungated: both cycle tests are numbers.
-- weight: heavy
create table flows (
    dataset varchar not null,               -- name of the dataset adapter
    sequence varchar not null,              -- drive or clip
    frame integer not null,                 -- frame the flow starts from
    round integer not null,                 -- EM round
    frame_to integer not null,              -- frame the flow points into
    direction varchar not null,             -- forward (frame_to is later) or backward
    method varchar not null,                -- dis or raft
    width_px integer not null,              -- image width
    height_px integer not null,             -- image height
    cycle_share_paper double,               -- share of pixels with |w+w''|^2 < 0.05(|w|^2+|w''|^2)+0.5 (eq. 5)
    cycle_share_release double,             -- share of pixels with |w+w''| < 0.05|[w,w'']|+0.5 px that map one to one
    cycle_error_median_px double,           -- median of |w+w''|, pixels that stay inside the image
    magnitude_median_px double,             -- median of |w|
    codec varchar not null,                 -- i16 (1/64 px) or f16
    data blob not null,                     -- encoded (H, W, 2) flow in pixels
    consistent blob                         -- encoded (H, W) bits: bit 0 the paper's cycle test, bit 1 the release's
);
