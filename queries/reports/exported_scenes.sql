-- Frames and labels as nuScenes groups them: a scene is a run of frames that egomotion links, an instance a track in one scene. One row a label, and one for each frame without labels.
-- step is the motion from the frame before (to_T_from; NULL where a scene begins, the identity for a
-- camera that does not move). previous_id, next_id and first_id are labels of the same instance; a
-- label without a track, and the less sure one of two labels of a track in a frame, is an instance
-- alone. visibility is 1 to 4: nuScenes' bins of the visible share.
set variable selection_id = null::varchar;     -- which selection; NULL = every one in the store
set variable exported_dataset = null::varchar;  -- which dataset; NULL = all
set variable first_sequence = null::varchar;   -- name of the first sequence, as text sorts; NULL = from the beginning
set variable last_sequence = null::varchar;    -- name of the last one; NULL = to the end
set variable keep_ignored = true;              -- true or false: undecided labels are written too
set variable pose_method = 'odometry';         -- estimator of egomotion; another counts where a sequence has none of it
set variable moving_above_mps = 1.0;           -- m/s * metric_scale: labels faster than this move
set variable low_visible_share = 0.4;          -- share of the outline in view: below it visibility is 1
set variable middle_visible_share = 0.6;       -- share of the outline in view: below it visibility is 2
set variable high_visible_share = 0.8;         -- share of the outline in view: below it visibility is 3, else 4

with shots as (
    select f.dataset, f.sequence, f.frame, s.static_camera, s.metric_scale,
           lag(f.frame) over (partition by f.dataset, f.sequence order by f.frame) as previous_frame
    from frames f
    join sequences s on (s.dataset, s.sequence, s.round) = (f.dataset, f.sequence, 1)
    where f.round = 1 and f.status = 'ok'
      and (getvariable('exported_dataset') is null or f.dataset = getvariable('exported_dataset'))
      and (getvariable('first_sequence') is null or f.sequence >= getvariable('first_sequence'))
      and (getvariable('last_sequence') is null or f.sequence <= getvariable('last_sequence'))
),
motions as (
    select e.dataset, e.sequence, e.frame, e.frame_to, e."to_T_from" as step
    from egomotions e
    semi join shots s on (s.dataset, s.sequence, s.frame) = (e.dataset, e.sequence, e.frame)
    where e.round = 1 and e."to_T_from" is not null
    qualify dense_rank() over (partition by e.dataset, e.sequence
                               order by e.method <> getvariable('pose_method'), e.method) = 1
),
linked as (
    select s.*,
           if(static_camera and previous_frame is not null,
              [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]::double[], m.step) as step
    from shots s
    left join motions m on (m.dataset, m.sequence, m.frame, m.frame_to)
                         = (s.dataset, s.sequence, s.previous_frame, s.frame)
),
scenes as (
    select *, sum((step is null)::integer) over (partition by dataset, sequence
                                                 order by frame)::integer as scene
    from linked
),
chosen as (
    select l.*, s.scene, s.metric_scale,
           l.track_id is not null
           and row_number() over (partition by l.dataset, l.sequence, l.frame, l.track_id, l.state
                                  order by l.score desc, l.proposal_id) = 1 as on_track
    from labels l
    join scenes s on (s.dataset, s.sequence, s.frame) = (l.dataset, l.sequence, l.frame)
    where (getvariable('selection_id') is null or l.selection_id = getvariable('selection_id'))
      and (l.state = 'positive' or getvariable('keep_ignored'))
),
tracked as (
    select *, if(on_track, track_id, proposal_id) as track from chosen
),
instances as (
    select dataset, sequence, frame, score, proposal_id,
           lag(proposal_id) over along as previous_id,
           lead(proposal_id) over along as next_id,
           first_value(proposal_id) over along as first_id,
           last_value(proposal_id) over whole as last_id,
           count(*) over whole as annotations,
           case when occluded_share is null then null
                when 1 - occluded_share < getvariable('low_visible_share') then 1
                when 1 - occluded_share < getvariable('middle_visible_share') then 2
                when 1 - occluded_share < getvariable('high_visible_share') then 3
                else 4 end as visibility,
           speed_mps > getvariable('moving_above_mps') * metric_scale as moving
    from tracked
    window along as (partition by dataset, sequence, scene, state, on_track, track order by frame),
           whole as (partition by dataset, sequence, scene, state, on_track, track order by frame
                     rows between unbounded preceding and unbounded following)
)
select s.dataset, s.sequence, s.frame, s.scene, s.step, i.proposal_id, i.previous_id, i.next_id,
       i.first_id, i.last_id, i.annotations, i.visibility, i.moving
from scenes s
left join instances i on (i.dataset, i.sequence, i.frame) = (s.dataset, s.sequence, s.frame)
order by s.dataset, s.sequence, s.frame, i.score desc, i.proposal_id
