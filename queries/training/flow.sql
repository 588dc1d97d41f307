-- The pairs that a flow network learns from and is checked with: their frames, each with the number
-- of those right behind it that it makes a pair with. Two frames of a pair have images of one size.
-- reads: image
set variable held_out_share = 0.2;  -- share: of each drive's pairs, its last ones, kept to check what was learnt
set variable max_step = 1;  -- frames: that a pair to learn from spans at most; a longer step shows larger motions
set variable most_learnt = 256;  -- frames: that begin a pair to learn from, at most, spread evenly over all that do
set variable most_held_out = 64;  -- pairs: to check with, at most, spread evenly over all that are held out

with listed as (
    select dataset, sequence, frame, has_image, lead(frame) over drive as frame_to,
           has_image and coalesce(lead(has_image) over drive, false)
           and (width_px, height_px)
               is not distinct from (lead(width_px) over drive, lead(height_px) over drive)
               as paired
    from frames
    where status = 'ok'
    window drive as (partition by dataset, sequence order by frame)
),
numbered as (
    select *, count(*) filter (paired) over before as number,
           count(*) filter (paired) over whole as pairs
    from listed
    window before as (partition by dataset, sequence order by frame),
           whole as (partition by dataset, sequence)
),
-- A pair that shares a frame with one held out is neither learnt from nor checked with.
parted as (
    select *, pairs - greatest(1, round(pairs * getvariable('held_out_share'))) as learnt
    from numbered
),
named as (
    select dataset, sequence, frame, case when paired then frame_to end as frame_to,
           case when not paired then null
                when number > learnt then 'held out'
                when number < learnt then 'learnt' end as part
    from parted
    where has_image
),
-- Neighbours of one part: what lies between them would break a longer step.
unbroken as (
    select *, count(*) filter (part is distinct from 'learnt') over before as broken
    from named
    window before as (partition by dataset, sequence order by frame)
),
counted as (
    select *,
           case part when 'held out' then 1
                     when 'learnt' then least(getvariable('max_step'), count(*) over following)
                     else 0 end as possible_steps,
           case part when 'held out' then getvariable('most_held_out')
                     else getvariable('most_learnt') end as most,
           row_number() over (partition by part order by dataset, sequence, frame) as place,
           count(*) over (partition by part) as places,
           row_number() over (partition by dataset, sequence order by frame) as image
    from unbroken
    window following as (partition by dataset, sequence, broken, part order by frame desc)
),
chosen as (
    select *, case when floor(place * most / places) > floor((place - 1) * most / places)
                   then greatest(possible_steps, 0) else 0 end as steps
    from counted
)
select dataset, sequence, frame, frame_to, part, steps, 0 as positives
from chosen
window before as (partition by dataset, sequence order by frame
                  rows between unbounded preceding and 1 preceding)
qualify steps > 0 or image <= max(image + steps) over before
order by dataset, sequence, frame
