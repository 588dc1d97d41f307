-- What is neither a label nor background: proposals that the preset does not accept, and its
-- loosened bounds or another preset do. The first that accepts one names it. No proposal is left
-- undecided where its centre lies in the box of a label of the same frame: the label says it all.
-- Reads `accepted`, the preset's labels, `acceptable`, what the alternatives accept (place: 1 for
-- the first), and where both stand, `proposals`.
with undecided as (
    select a.*
    from acceptable a
    anti join accepted p on p.proposal_id = a.proposal_id
    qualify row_number() over (partition by a.proposal_id order by a.place) = 1
),
undecided_boxes as (
    select b.* from undecided u join proposals b on b.proposal_id = u.proposal_id
),
label_boxes as (
    select b.* from accepted a join proposals b on b.proposal_id = a.proposal_id
),
under_a_label as (
    select u.proposal_id
    from undecided_boxes u
    join label_boxes t using (dataset, sequence, frame)
    where abs((u.x_m - t.x_m) * cos(t.yaw_rad) - (u.z_m - t.z_m) * sin(t.yaw_rad)) <= t.length_m / 2
      and abs((u.x_m - t.x_m) * sin(t.yaw_rad) + (u.z_m - t.z_m) * cos(t.yaw_rad)) <= t.width_m / 2
)
select u.*
from undecided u
anti join under_a_label l on l.proposal_id = u.proposal_id
