-- Rigid motion of the level frame between two frames, by one estimator.
-- weight: light
create table egomotions (
    dataset varchar not null,         -- name of the dataset adapter
    sequence varchar not null,        -- drive or clip
    frame integer not null,           -- frame t
    round integer not null,           -- EM round
    frame_to integer not null,        -- next usable frame
    method varchar not null,          -- odometry or flow_ransac
    to_T_from double[],               -- 16 numbers, row-major: points of `frame` to `frame_to`, level frames (forward estimate)
    from_T_to double[],               -- 16 numbers: the backward estimate, made on its own
    inliers integer,                  -- point flows within the inlier radius (flow_ransac), or matched points
    inlier_share double,              -- inliers over all that were tried
    residual_m double,                -- root mean square of the inliers
    translation_m double,             -- length of the forward translation
    rotation_rad double,              -- angle of the forward rotation
    cycle_error_m double,             -- max over the sweep of |backward(forward(x)) - x| (eq. 6, 7)
    alignment_share double,           -- share of non-ground points of `frame` with a neighbour within 0.15 m * metric_scale in the frame 10 later (or the last), carried there by the chained motion
    alignment_frames integer          -- how many frames later that was measured
);
