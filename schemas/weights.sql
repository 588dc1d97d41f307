-- The numbers of a model's newest checkpoint.
-- weight: heavy
create table weights (
    model_id varchar not null,   -- models.model_id
    part varchar not null,       -- average (of the weights over the steps: what evidence is measured with) or state (all that training goes on from)
    step bigint not null,        -- steps done
    sha256 varchar not null,     -- of data
    data blob not null           -- written by torch.save; reads with weights_only
);
