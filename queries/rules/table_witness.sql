-- A thing on a table has a witness: free space shows that it moved while the clip ran, or, in later
-- rounds, the detector takes it for an object. The value is the surer of the two. Abstains on
-- everything else.
-- source: section 3.7: what moves is found first; section 3.6: then what looks like it
-- needs: value >= min_witness
-- cues: table_clusters, table_motion
set variable min_witness = 0.4;  -- share or probability: of its points seen through, or of a centre in the footprint

select p.proposal_id, greatest(m.confidence, d.confidence)::double as value,
       getvariable('min_witness')::double as bound,
       case when p.source = 'table' then coalesce(value >= bound, false) end as passed
from proposals p
left join confidences m on m.proposal_id = p.proposal_id and m.module = 'moved'
left join confidences d on d.proposal_id = p.proposal_id and d.module = 'objectness_3d'
