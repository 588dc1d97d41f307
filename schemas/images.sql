-- A frame's image: where it lies, or its bytes.
-- weight: heavy
create table images (
    dataset varchar not null,                  -- name of the dataset adapter
    sequence varchar not null,                 -- drive or clip
    frame integer not null,                    -- number of the frame
    round integer not null,                    -- EM round
    image struct(bytes blob, path varchar)     -- encoded image, or its path relative to sequences.root
);
