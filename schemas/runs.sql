-- What made the store: one row a build, written before its work starts. It holds no
-- clock and no host, so that the same build leaves the same row.
-- weight: light
create table runs (
    run_id varchar not null,              -- hash of the other columns
    command varchar not null,             -- build
    version varchar not null,             -- tcrdata's version
    settings varchar not null,            -- JSON: dataset, root, sequences, frames, stages, presets and every setting used
    packages map(varchar, varchar) not null,  -- versions of the packages that make numbers
    units bigint not null                 -- units of work the build covers
);
