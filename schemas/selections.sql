-- One run of a preset over a frozen list of files.
-- weight: light
create table selections (
    selection_id varchar not null,      -- hash of rule texts, parameters and snapshot
    name varchar not null,              -- name given by the user, or the preset's
    preset varchar not null,            -- preset that was run
    round integer not null,             -- EM round
    snapshot varchar not null,          -- the list of files it read
    rules varchar[] not null,           -- names of the rules, in order
    rule_texts varchar[] not null,      -- each rule's select with its parameters filled in
    required boolean[] not null,        -- whether abstaining fails the proposal, a rule each
    preset_text varchar not null,       -- the preset's select with its parameters filled in
    parameters map(varchar, varchar) not null,  -- every parameter used, as SQL literals
    alternatives varchar,               -- JSON: what else was judged; what only these accept is ignore
    proposals_judged bigint not null,   -- proposals the rules saw
    labels bigint not null,             -- positive labels that came out
    ignored bigint                      -- labels left undecided
);
