-- What no cue could work with: frames that cannot be read, and frames without a usable image.
set variable messages_listed = 40;  -- messages: no more than these, the most frequent first

select dataset, sequence, if(status = 'ok', 'image', 'frame') as what,
       coalesce(error, image_error, 'no image') as message,
       count(*) as frames, min(frame) as first_frame, max(frame) as last_frame,
       count(*) over () as messages
from frames
where status != 'ok' or not has_image
group by all
order by what, frames desc, dataset, sequence, message
limit getvariable('messages_listed')
