-- The track goes somewhere. How far it must go depends on how long it was seen and how straight it
-- ran: a long, straight track is trusted earlier, and so is one that the clip's end cut off.
-- Abstains on what is no track.
-- source: ours
-- needs: value >= min_travel_m, min_travel_long_m or min_travel_cut_m, times metric_scale;
--   too young or too crooked: never
-- cues: tracks
set variable min_travel_m = 3.0;  -- m: for any track
set variable min_age_frames = 4;  -- frames: any track must have been observed in
set variable min_straightness = 0.5;  -- ratio: travel over path length, above it; any or cut track
set variable min_travel_long_m = 1.5;  -- m: for a long track
set variable min_age_long_frames = 8;  -- frames: a long track has been observed in
set variable min_straightness_long = 0.6;  -- ratio: travel over path length, above it; long track
set variable min_travel_cut_m = 1.0;  -- m: for a track at the first or last frame of the clip
set variable min_age_cut_frames = 3;  -- frames: the same for one at the clip's end

select p.proposal_id, p.travel_m as value,
       p.metric_scale * (case
           when p.straightness <= getvariable('min_straightness') then 'infinity'::double
           when p.at_clip_edge and p.age_frames >= getvariable('min_age_cut_frames')
               then getvariable('min_travel_cut_m')
           when p.age_frames >= getvariable('min_age_long_frames')
                and p.straightness > getvariable('min_straightness_long')
               then getvariable('min_travel_long_m')
           when p.age_frames >= getvariable('min_age_frames') then getvariable('min_travel_m')
           else 'infinity'::double end)::double as bound,
       case when p.source = 'track' then value >= bound end as passed
from proposals p
