-- Our default, and things of a vehicle's shape that never moved while the clip ran. Where such a box
-- overlaps the box of a track in the same frame, the track wins.
-- rules: source, travels, core_share, height, near_observation, enough_points, range, static_length, static_width,
--   static_height, static_edge_share,
--   cycle_error, alignment
-- required: source
-- cues: odometry, tracks, static_clusters
set variable taken_source = 'track';
set variable also_taken_source = 'static';
set variable taken_fit = 'track';
set variable egomotion_method = 'odometry';
set variable score_track_travel_m = 3.0;  -- m: a track that goes this far has 0.63 of the highest score
set variable score_filled_frames = 10;  -- frames: a filled box this far from a sighting keeps 0.37

-- Two rectangles seen from above overlap unless one of their four axes separates them.
with pairs as (
    select s.proposal_id,
           t.x_m - s.x_m as dx, t.z_m - s.z_m as dz, s.yaw_rad as s_yaw, t.yaw_rad as t_yaw,
           abs(cos(t.yaw_rad - s.yaw_rad)) as c, abs(sin(t.yaw_rad - s.yaw_rad)) as n,
           s.length_m / 2 as s_l, s.width_m / 2 as s_w, t.length_m / 2 as t_l, t.width_m / 2 as t_w
    from proposals s
    join proposals t on (t.dataset, t.sequence, t.frame) = (s.dataset, s.sequence, s.frame)
    where s.source = 'static' and t.source = 'track'
),
overlapped as (
    select distinct proposal_id
    from pairs
    where abs(dx * cos(s_yaw) - dz * sin(s_yaw)) < s_l + t_l * c + t_w * n
      and abs(dx * sin(s_yaw) + dz * cos(s_yaw)) < s_w + t_l * n + t_w * c
      and abs(dx * cos(t_yaw) - dz * sin(t_yaw)) < t_l + s_l * c + s_w * n
      and abs(dx * sin(t_yaw) + dz * cos(t_yaw)) < t_w + s_l * n + s_w * c
)
select p.proposal_id, 'positive' as state,
       case p.source
           when 'static' then p.edge_share
           else (1 - exp(-p.travel_m / (getvariable('score_track_travel_m') * p.metric_scale)))
                * p.track_core_share
                * exp(-coalesce(p.frames_from_observation, 0) / getvariable('score_filled_frames'))
       end as score
from proposals p
anti join overlapped o on o.proposal_id = p.proposal_id
