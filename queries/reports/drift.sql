-- Whether a round's labels drift from those of the round before. agreement: of the positive labels
-- that the detector speaks of, the share that it is sure of; of each round by its own detector, of a
-- round that had none by that of the round after it. worse: why the round is worth a look, or NULL.
set variable selection_a = null::varchar;  -- id of the selection of the round before
set variable selection_b = null::varchar;  -- id of the selection of the round
set variable lost = 0;                     -- labels: of A that B has not, as report diff counts them
set variable sure_confidence = 0.5;        -- probability: from here on the detector is sure
set variable most_lost_share = 0.1;        -- share: of A's labels that a round may lose
set variable most_fall = 0.05;             -- share: by which agreement may fall

with rounds as (
    select max(round) filter (selection_id = getvariable('selection_a')) as a,
           max(round) filter (selection_id = getvariable('selection_b')) as b
    from selections
),
said as (
    select proposal_id, confidence >= getvariable('sure_confidence') as sure, c.round
    from confidences c
    where module = 'objectness_3d' and confidence is not null
),
judged as (
    select l.selection_id, coalesce(own.sure, next.sure) as sure
    from labels l
    cross join rounds r
    left join said own
        on own.proposal_id = l.proposal_id
        and own.round = if(l.selection_id = getvariable('selection_a'), r.a, r.b)
    left join said next
        on next.proposal_id = l.proposal_id and next.round = r.b and r.a < r.b
    where l.state = 'positive'
      and l.selection_id in (getvariable('selection_a'), getvariable('selection_b'))
),
counted as (
    select count(*) filter (selection_id = getvariable('selection_a')) as labels_a,
           count(*) filter (selection_id = getvariable('selection_b')) as labels_b,
           avg(sure::integer) filter (selection_id = getvariable('selection_a')) as agreement_a,
           avg(sure::integer) filter (selection_id = getvariable('selection_b')) as agreement_b
    from judged
)
select r.a as round_a, r.b as round_b, labels_a, labels_b, agreement_a, agreement_b,
       nullif(concat_ws('; ',
           if(getvariable('lost') > getvariable('most_lost_share') * labels_a,
              format('lost {} of {} labels', getvariable('lost'), labels_a), null),
           if(agreement_b < agreement_a - getvariable('most_fall'),
              format('agreement fell from {:.2f} to {:.2f}', agreement_a, agreement_b), null)),
           '') as worse
from counted
cross join rounds r
where r.b is not null
