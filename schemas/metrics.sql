-- A score of a selection.
-- weight: light
create table metrics (
    selection_id varchar not null,   -- selections.selection_id
    dataset varchar not null,        -- name of the dataset adapter, or all
    sequence varchar not null,       -- drive or clip, or all
    subset varchar not null,         -- all or moving
    view varchar not null,           -- bev or 2d
    metric varchar not null,         -- ap_per_frame, ap_pooled, precision, recall; of tracking: kind of tracklet.score
    iou double not null,             -- threshold; 0 where a score of tracking has none
    dont_care boolean not null,      -- labels mainly inside DontCare regions were left out
    value double,                    -- in [0, 1], MOTA down from 1, switches a count; NULL when there is nothing to score
    predictions bigint not null,     -- labels scored
    truths bigint not null           -- labelled objects scored
);
