"""Rules and presets in SQL: loading them, judging with them, and the selections they make."""

from tcrdata.rules.checks import checks_view_sql
from tcrdata.rules.parameters import Parameter
from tcrdata.rules.preset_files import (
    PresetText,
    load_follower,
    load_preset,
    preset_names,
    read_preset,
)
from tcrdata.rules.presets import Preset
from tcrdata.rules.rule_files import Rule, RuleText, load_rules
from tcrdata.rules.selections import Selection, select

__all__ = [
    "Parameter",
    "Preset",
    "PresetText",
    "Rule",
    "RuleText",
    "Selection",
    "checks_view_sql",
    "load_follower",
    "load_preset",
    "load_rules",
    "preset_names",
    "read_preset",
    "select",
]
