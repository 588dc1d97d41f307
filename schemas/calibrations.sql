-- How far a module's confidences can be trusted in a round: how sure the other modules are of the
-- same proposals. No ground truth is read.
-- weight: light
create table calibrations (
    round integer not null,              -- EM round
    module varchar not null,             -- confidences.module
    confidence_low double not null,      -- the module's confidence, from here
    confidence_high double not null,     -- up to here
    proposals bigint not null,           -- proposals with such a confidence of which another module speaks
    others_confidence double not null,   -- mean over them of the other modules' mean confidence
    calibrated double not null           -- the same, made to rise with the confidence (isotonic regression)
);
