-- A proposal that a selection accepts (positive) or leaves undecided (ignore).
-- weight: light
create table labels (
    selection_id varchar not null,   -- selections.selection_id
    proposal_id varchar not null,    -- proposals.proposal_id
    dataset varchar not null,        -- name of the dataset adapter
    sequence varchar not null,       -- drive or clip
    frame integer not null,          -- number of the frame
    round integer not null,          -- EM round
    state varchar not null,          -- positive or ignore
    ignored_because varchar,         -- ignore: loosened, or the preset that accepts it; NULL for positives
    score double not null,           -- in [0, 1], larger is surer
    source varchar not null,         -- proposals.source
    track_id varchar,                -- proposals.track_id
    x_m double not null,             -- geometric centre, level frame
    y_m double not null,             -- geometric centre, level frame
    z_m double not null,             -- geometric centre, level frame
    length_m double not null,        -- along the heading
    width_m double not null,         -- across the heading
    height_m double not null,        -- along y
    yaw_rad double not null,         -- about y; heading = (cos yaw, 0, -sin yaw)
    yaw_observable boolean,          -- false: round from above, the yaw means nothing; NULL where nobody asked
    left_px double,                  -- clipped to the image
    top_px double,                   -- clipped to the image
    right_px double,                 -- clipped to the image
    bottom_px double,                -- clipped to the image
    center_u_px double,              -- projection of the 3D centre
    center_v_px double,              -- projection of the 3D centre
    truncated_share double,          -- share of the unclipped 2D box outside the image
    occluded_share double,           -- share of the visible outline with a nearer return in front
    number_of_points integer,        -- points of the proposal
    speed_mps double,                -- speed at this frame
    carried_by varchar[]             -- rules that judged and passed it
);
