-- What each rule of each selection says of each proposal, rejected ones too.
-- A view: verdicts follow from frozen evidence and the rule texts kept in `selections`,
-- so they are worked out when asked for and cost no storage. The table below fixes its columns.
-- weight: view
create table checks (
    selection_id varchar not null,   -- selections.selection_id
    selection varchar not null,      -- selections.name
    proposal_id varchar not null,    -- proposals.proposal_id
    rule varchar not null,           -- name of the rule
    value double,                    -- what was measured
    bound double,                    -- what it was compared with
    passed boolean                   -- NULL = the rule abstains: no evidence
);
