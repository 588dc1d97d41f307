-- What a finetuned flow network and its teacher say of a pair of frames that neither learnt from.
-- weight: light
create table flow_checks (
    model_id varchar not null,       -- models.model_id of the finetuned network that is checked
    role varchar not null,           -- student or teacher: whose numbers these are
    measured_id varchar not null,    -- models.model_id of the network whose numbers these are
    dataset varchar not null,        -- name of the dataset adapter
    sequence varchar not null,       -- drive or clip
    frame integer not null,          -- frame the flow starts from
    frame_to integer not null,       -- frame the flow points into
    pixels bigint not null,          -- of an image
    consistent_share double not null,   -- share of pixels with |w+w''|^2 < 0.05(|w|^2+|w''|^2)+0.5 (eq. 5)
    inside_share double not null,       -- share of pixels whose flow ends inside the image
    photometric_error double,        -- mean |I1(p) - I2(p+w)| of colours in [0, 1], over these; NULL without any
    magnitude_median_px double not null  -- median of |w|
);
