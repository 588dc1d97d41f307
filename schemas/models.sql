-- A network and what it was trained on, as its newest checkpoint has it.
-- weight: light
create table models (
    model_id varchar not null,        -- hash of kind, network, settings, seed, query, labels and snapshot
    kind varchar not null,            -- detector, segmenter or flow
    network varchar not null,         -- module of tcrdata.networks, or a dotted path
    labels_round integer not null,    -- EM round of the labels it learns from
    selection_id varchar not null,    -- selections.selection_id of the labels; empty for flow, which needs none
    snapshot varchar not null,        -- the frozen list of files that the training reads; empty where it reads none
    query varchar not null,           -- select that gave the samples, parameters filled in
    settings varchar not null,        -- JSON: network, training, augmentation and targets
    seed bigint not null,             -- of weights, order and augmentation
    samples bigint not null,          -- frames it learns from; 1 where they are generated
    positives bigint not null,        -- positive labels in them
    parameters bigint not null,       -- numbers learnt
    step bigint not null,             -- steps done
    steps bigint not null,            -- steps to do
    finished boolean not null,        -- step = steps
    losses double[] not null,         -- loss of each step
    terms map(varchar, double) not null  -- mean of each part of the loss over the last tenth of the steps
);
