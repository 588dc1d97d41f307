-- How much of each sequence an export is about: frames that can be read, labels, labels left undecided, frames with an image, and labels that the build placed in one.
set variable selection_id = null::varchar;     -- which selection; NULL = every one in the store
set variable exported_dataset = null::varchar;  -- which dataset; NULL = all
set variable keep_ignored = true;              -- true or false: undecided labels are written too

with readable as (
    select dataset, sequence, frame, has_image
    from frames
    where round = 1 and status = 'ok'
      and (getvariable('exported_dataset') is null or dataset = getvariable('exported_dataset'))
),
labelled as (
    select l.dataset, l.sequence, count(*) filter (state = 'positive') as labels,
           count(*) filter (state <> 'positive' and getvariable('keep_ignored')) as ignored,
           count(*) filter (state = 'positive' and has_image and left_px is not null) as in_images
    from labels l
    join readable f on (f.dataset, f.sequence, f.frame) = (l.dataset, l.sequence, l.frame)
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
    group by all
)
select dataset, sequence, count(*) as frames,
       coalesce(any_value(labels), 0) as labels, coalesce(any_value(ignored), 0) as ignored,
       count(*) filter (has_image) as images, coalesce(any_value(in_images), 0) as in_images
from readable
left join labelled using (dataset, sequence)
group by dataset, sequence
order by dataset, sequence
