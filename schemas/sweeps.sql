-- A frame's points: where they lie, or their bytes.
-- weight: heavy
create table sweeps (
    dataset varchar not null,    -- name of the dataset adapter
    sequence varchar not null,   -- drive or clip
    frame integer not null,      -- number of the frame
    round integer not null,      -- EM round
    path varchar,                -- relative to sequences.root; NULL when generated
    number_of_points integer,    -- finite points
    codec varchar,               -- how data is encoded; NULL when only the path is kept
    data blob                    -- xyz (m, level frame) and reflectance, encoded; NULL when only the path is kept
);
