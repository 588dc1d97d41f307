-- What was trained in a store: on which labels and snapshot, how far, and how well it fits them.
set variable trained_kind = null::varchar;  -- detector, segmenter or flow; NULL = all
set variable loss_window_share = 0.1;       -- share: of the steps, at either end, that losses are averaged over

with measured as (
    select m.*, s.name as selection,
           greatest(1, round(step * getvariable('loss_window_share')))::bigint as span
    from models m
    left join (select distinct selection_id, name from selections) s using (selection_id)
    where getvariable('trained_kind') is null or kind = getvariable('trained_kind')
)
select model_id, kind, network, labels_round, coalesce(selection, selection_id) as labels, snapshot,
       seed, samples, positives, parameters, step, steps, finished,
       list_avg(losses[:span]) as first_loss, list_avg(losses[-span:]) as last_loss,
       terms, settings
from measured
order by labels_round, kind, model_id
