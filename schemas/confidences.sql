-- What one module says of one proposal. Long form: a new module only appends.
-- weight: light
create table confidences (
    proposal_id varchar not null,   -- proposals.proposal_id
    dataset varchar not null,       -- name of the dataset adapter
    sequence varchar not null,      -- drive or clip
    frame integer not null,         -- number of the frame
    round integer not null,         -- EM round
    source varchar,                 -- proposals.source, copied: a check skips the files of other sources
    module varchar not null,        -- free_space, motion_3d, motion_2d ...
    confidence double,              -- in [0, 1]; NULL = no evidence
    raw_value double,               -- the number it was made from
    unit varchar not null           -- unit of raw_value
);
