-- Every track's box, judged by what four modules say of it together.
-- rules: source, modules_agree
-- required: source, modules_agree
-- cues: tracks

select p.proposal_id, 'positive' as state, 1.0::double as score from proposals p
