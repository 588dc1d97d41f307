-- How the labels spread over distance, size, speed, points, visibility and score: counts a bin.
-- Bins are 1, 2 or 5 times a power of ten wide; the last one holds all that lies beyond, too.
set variable selection_id = null::varchar;  -- which selection; NULL = every one in the store
set variable bins_wanted = 18;              -- bins: about so many, over what most labels span
set variable spanned_share = 0.99;          -- share: of the labels that lie below the last bin's end

with measured as (
    select state, unnest([
               {'place': 1, 'name': 'distance', 'unit': 'm', 'value': sqrt(x_m * x_m + z_m * z_m)},
               {'place': 2, 'name': 'length', 'unit': 'm', 'value': length_m},
               {'place': 3, 'name': 'speed', 'unit': 'm/s', 'value': speed_mps},
               {'place': 4, 'name': 'points', 'unit': '', 'value': number_of_points::double},
               {'place': 5, 'name': 'hidden share', 'unit': '', 'value': occluded_share},
               {'place': 6, 'name': 'score', 'unit': '', 'value': score}
           ], recursive := true)
    from labels
    where getvariable('selection_id') is null or selection_id = getvariable('selection_id')
),
spans as (
    select name, greatest(quantile_cont(value, getvariable('spanned_share')), 1e-6)
                 / getvariable('bins_wanted') as wanted,
           pow(10, floor(log10(wanted))) as power,
           power * case when wanted <= power then 1 when wanted <= 2 * power then 2
                        when wanted <= 5 * power then 5 else 10 end as step,
           floor(quantile_cont(value, getvariable('spanned_share')) / step) as last_bin
    from measured
    where isfinite(value)
    group by all
)
select place, name, unit, step, last_bin::bigint as last_bin,
       least(floor(value / step), last_bin)::bigint as bin,
       count(*) filter (state = 'positive') as positives,
       count(*) filter (state = 'ignore') as ignored
from measured
join spans using (name)
where isfinite(value)
group by all
order by place, bin
