-- The tracks of the drives with the most labels, cut into runs of frames of one kind:
--   observed, occluded: a label on points of its own, mostly visible or mostly hidden;
--   gap, extended: a label filled in between two sightings, or beyond the first or last;
--   ignored: neither right nor wrong; rejected: the track was there, and a rule failed it.
-- Labels without a track share one row a drive, whose track_id is empty.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable drives_shown = 6;              -- drives: those with the most labels
set variable tracks_shown = 24;             -- tracks: a drive, those with the most labels
set variable occluded_from_share = 0.5;     -- share: of the outline behind nearer returns

with shots as (
    select dataset, sequence, frame, min(frame) over drive as drive_first,
           max(frame) over drive as drive_last,
           row_number() over (partition by dataset, sequence order by frame) as shot
    from frames
    where status = 'ok'
    window drive as (partition by dataset, sequence)
),
accepted as (
    select dataset, sequence, frame, proposal_id, coalesce(track_id, '') as track_id, state, score,
           occluded_share
    from labels
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
drives as (
    select dataset, sequence, count(*) as drive_labels,
           row_number() over (order by count(*) desc, dataset, sequence) as drive_place
    from accepted
    where state = 'positive'
    group by dataset, sequence
    qualify drive_place <= getvariable('drives_shown')
),
tracks as (
    select dataset, sequence, track_id, drive_labels, drive_place,
           count(*) filter (state = 'positive') as track_labels,
           avg(score) filter (state = 'positive') as mean_score,
           row_number() over (partition by dataset, sequence
                              order by count(*) filter (state = 'positive') desc, track_id)
               as track_place,
           count(*) over (partition by dataset, sequence) as drive_tracks
    from accepted
    join drives using (dataset, sequence)
    group by dataset, sequence, track_id, drive_labels, drive_place
    having count(*) filter (state = 'positive') > 0
    qualify track_place <= getvariable('tracks_shown')
),
members as (
    select t.dataset, t.sequence, t.track_id, p.frame, a.state, p.found, p.occluded_share
    from tracks t
    join proposals p using (dataset, sequence, track_id)
    left join accepted a using (dataset, sequence, proposal_id)
    union all
    select dataset, sequence, track_id, frame, state, 'observed', a.occluded_share
    from tracks
    join accepted a using (dataset, sequence, track_id)
    where track_id = ''
),
kinds as (
    select dataset, sequence, track_id, frame,
           case when max(state) is null then 'rejected'
                when max(state) = 'ignore' then 'ignored'
                when arg_min(found, state is null) != 'observed' then arg_min(found, state is null)
                when min(occluded_share) >= getvariable('occluded_from_share') then 'occluded'
                else 'observed' end as kind
    from members
    group by all
),
islands as (
    select k.*, s.drive_first, s.drive_last,
           shot - row_number() over (partition by dataset, sequence, track_id, kind order by frame)
               as island
    from kinds k
    join shots s using (dataset, sequence, frame)
),
runs as (
    select dataset, sequence, track_id, kind, drive_first, drive_last, island,
           min(frame) as first_frame, max(frame) as last_frame, count(*) as frames
    from islands
    group by all
)
select drive_place, dataset, sequence, drive_first, drive_last, drive_labels, drive_tracks,
       track_place, track_id, track_labels, mean_score, kind, first_frame, last_frame, frames
from runs
join tracks using (dataset, sequence, track_id)
order by drive_place, track_place, first_frame, kind
