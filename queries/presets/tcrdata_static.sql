-- Our default, and things of a vehicle's shape that never moved while the clip ran. Where such a box
-- overlaps the box of a track in the same frame, the track wins.
-- rules: source, travels, core_share, height, range, not_overlapped, near_observation,
--   extended_points, static_length, static_width, static_height,
--   static_edge_share, cycle_error, alignment
-- required: source
-- cues: odometry, tracks, static_clusters
set variable taken_source = 'track';
set variable also_taken_source = 'static';
set variable taken_fit = 'track';
set variable egomotion_method = 'odometry';
set variable alignment_method = 'odometry';

-- Two rectangles seen from above overlap unless one of their four axes separates them.
with pairs as (
    select s.proposal_id,
           t.x_m - s.x_m as dx, t.z_m - s.z_m as dz, s.yaw_rad as s_yaw, t.yaw_rad as t_yaw,
           abs(cos(t.yaw_rad - s.yaw_rad)) as c, abs(sin(t.yaw_rad - s.yaw_rad)) as n,
           s.length_m / 2 as s_l, s.width_m / 2 as s_w, t.length_m / 2 as t_l, t.width_m / 2 as t_w
    from proposals s
    join proposals t using (dataset, sequence, frame)
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
-- A static thing is surer the more of its points lie along the sides of its box.
select p.proposal_id, 'positive' as state, coalesce(c.confidence, p.edge_share, 0)::double as score
from proposals p
anti join overlapped o on o.proposal_id = p.proposal_id
left join confidences c on c.proposal_id = p.proposal_id and c.module = 'track'
