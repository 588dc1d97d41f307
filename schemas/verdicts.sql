-- What all rules of a selection say of a proposal, in one row: what to count and group by when there
-- are many. A view, worked out like `checks` and in one pass over the proposals.
-- Element i of each list belongs to rule i; bit i - 1 of each mask likewise.
-- weight: view
create table verdicts (
    selection_id varchar not null,   -- selections.selection_id
    selection varchar not null,      -- selections.name
    proposal_id varchar not null,    -- proposals.proposal_id
    dataset varchar not null,        -- name of the dataset adapter
    sequence varchar not null,       -- drive or clip
    frame integer not null,          -- number of the frame
    source varchar not null,         -- proposals.source
    rules varchar[] not null,        -- names of the rules, in order
    value double[] not null,         -- what was measured
    bound double[] not null,         -- what it was compared with
    margin double[] not null,        -- |value - bound| / |bound| (1 where that is 0); negative where it fails
    passed boolean[] not null,       -- NULL = the rule abstains: no evidence
    failed bigint not null,          -- mask of the rules that fail it
    abstained bigint not null,       -- mask of the rules that abstain
    blocked bigint not null          -- mask of the rules that keep it out: failed, or required and abstaining
);
