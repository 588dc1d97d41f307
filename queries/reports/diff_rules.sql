-- What differs between the rules of two selections: a row a rule of either. change: same, parameters
-- (only values filled into its text), text (the rule itself was edited), required, only in A, only in
-- B. The preset's select is a rule here too. parameters: those whose value changed, in A and in B.
set variable selection_a = null::varchar;  -- id of the selection to start from
set variable selection_b = null::varchar;  -- id of the selection to compare with it
-- regular expression: a filled-in parameter, a literal in brackets of its own
set variable filled_in = '\((?:''(?:[^'']|'''')*''|-?[0-9.]+|true|false)\)';  -- pattern: see above

with texts as (
    select selection_id, unnest(rules) as rule, unnest(rule_texts) as text,
           unnest(required) as required, generate_subscripts(rules, 1) as place
    from selections
    union all
    select selection_id, 'select of the preset', preset_text, false, len(rules) + 1 from selections
),
settings as (
    select selection_id, unnest(map_entries(parameters), recursive := true) from selections
),
changed as (
    select name, a.value as value_a, b.value as value_b
    from (select key as name, value from settings
          where selection_id = getvariable('selection_a')) a
    full join (select key as name, value from settings
               where selection_id = getvariable('selection_b')) b using (name)
    where a.value is distinct from b.value
),
paired as (
    select rule, a.text as text_a, b.text as text_b, a.required as required_a,
           b.required as required_b, coalesce(a.place, b.place) as place,
           regexp_replace(a.text, getvariable('filled_in'), '', 'g')
               is distinct from regexp_replace(b.text, getvariable('filled_in'), '', 'g') as reworded,
           list_zip(regexp_extract_all(a.text, getvariable('filled_in')),
                    regexp_extract_all(b.text, getvariable('filled_in'))) as literals
    from (from texts where selection_id = getvariable('selection_a')) a
    full join (from texts where selection_id = getvariable('selection_b')) b using (rule)
),
-- A literal that differs belongs to the parameters that changed from the one to the other.
explained as (
    select rule, literal, list(name order by name) filter (name is not null) as names
    from (select rule, unnest(list_distinct(literals)) as literal from paired where not reworded)
    left join changed
        on literal[1] = '(' || value_a || ')' and literal[2] = '(' || value_b || ')'
    where literal[1] is distinct from literal[2]
    group by all
),
causes as (
    select rule, bool_or(names is null) as unexplained,
           list_sort(list_distinct(flatten(list(names)))) as names
    from explained
    group by rule
)
select rule,
       case when text_a is null then 'only in B' when text_b is null then 'only in A'
            when reworded or unexplained then 'text' when names is not null then 'parameters'
            when required_a <> required_b then 'required' else 'same' end as change,
       coalesce((select list({'name': name, 'a': value_a, 'b': value_b} order by name) from changed
                 where list_contains(names, name)), []) as parameters,
       text_a, text_b
from paired
left join causes using (rule)
order by place, rule
