-- No surer track has this place in this frame already: fragments of one object give one label.
-- source: ours
-- needs: value < max_overlapped_share
-- cues: tracks
set variable max_overlapped_share = 0.5;  -- share: of the footprint that a surer track covers

select p.proposal_id, p.overlapped_share as value,
       getvariable('max_overlapped_share')::double as bound,
       value < bound as passed
from proposals p
