-- What made the store: one row a build, content-named, so that the same build leaves the same row.
-- weight: light
create table runs (
    run_id varchar not null,              -- hash of the other columns
    command varchar not null,             -- build
    version varchar not null,             -- tcrdata's version
    settings varchar not null,            -- JSON: every setting used
    packages map(varchar, varchar) not null,  -- versions of the packages that make numbers
    units bigint not null,                -- units the build covers
    failed_units bigint not null          -- units that could not be made
);
