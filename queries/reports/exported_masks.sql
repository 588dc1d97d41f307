-- The pixels of the labels that an export of masks writes: of each label whose proposal has a mask its COCO run-length string, else the proposal's points, in the order of sequences and frames.
set variable selection_id = null::varchar;     -- which selection; NULL = every one in the store
set variable exported_dataset = null::varchar;  -- which dataset; NULL = all
set variable first_sequence = null::varchar;   -- name of the first sequence, as text sorts; NULL = from the beginning
set variable last_sequence = null::varchar;    -- name of the last one; NULL = to the end
set variable keep_ignored = true;              -- true or false: undecided labels are written too
set variable with_points = true;               -- true or false: points stand in for masks that there are not

select l.dataset, l.sequence, l.frame, l.proposal_id, p.mask,
       if(p.mask is null and getvariable('with_points'), p.point_indices, null) as point_indices
from labels l
join proposals p on (p.dataset, p.sequence, p.frame, p.round, p.proposal_id)
                  = (l.dataset, l.sequence, l.frame, l.round, l.proposal_id)
where (p.mask is not null or getvariable('with_points') and p.point_indices is not null)
  and (getvariable('selection_id') is null or l.selection_id = getvariable('selection_id'))
  and (getvariable('exported_dataset') is null or l.dataset = getvariable('exported_dataset'))
  and (getvariable('first_sequence') is null or l.sequence >= getvariable('first_sequence'))
  and (getvariable('last_sequence') is null or l.sequence <= getvariable('last_sequence'))
  and (l.state = 'positive' or getvariable('keep_ignored'))
order by l.dataset, l.sequence, l.frame, l.proposal_id
