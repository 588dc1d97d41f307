"""Settings, frame ranges and the registry: names, types, near misses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from tcrdata import registry
from tcrdata.errors import SettingsError
from tcrdata.frame_ranges import parse_frame_ranges
from tcrdata.settings import as_plain, digest, overridden, parse_assignments, read_toml


@dataclass(frozen=True)
class Cue:
    margin_m: float = 0.3
    window: int = 20
    offsets: tuple[int, ...] = (1, 2)
    refine: bool = True
    method: str = "odometry"


def test_values_take_the_type_of_their_field() -> None:
    changed = overridden(
        Cue(),
        {"margin_m": "1", "window": "7", "offsets": "1,3,5", "refine": "false", "method": "flow"},
        "cue",
    )
    assert changed == Cue(1.0, 7, (1, 3, 5), False, "flow")
    assert isinstance(changed.margin_m, float)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"margin": "1"}, "did you mean margin_m"),
        ({"window": "many"}, "cue.window: 'many' is no int"),
        ({"refine": "1"}, "neither true nor false"),
    ],
)
def test_wrong_values_are_named(values: dict[str, str], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        overridden(Cue(), values, "cue")


def test_assignments_need_a_name_and_a_value() -> None:
    assert parse_assignments(["a.b=c=d", " x = 1 "]) == {"a.b": "c=d", "x": "1"}
    with pytest.raises(SettingsError, match="NAME=VALUE"):
        parse_assignments(["novalue"])


def test_toml_becomes_assignments(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    file.write_text("max_cycle_error_m = 0.1\n[free_space]\nmargin_m = 0.2\noffsets = [1, 2]\n")
    assert read_toml(str(file)) == {
        "max_cycle_error_m": "0.1",
        "free_space.margin_m": "0.2",
        "free_space.offsets": "[1, 2]",
    }
    file.write_text("= nothing")
    with pytest.raises(SettingsError, match=r"s\.toml"):
        read_toml(str(file))
    with pytest.raises(SettingsError, match="cannot read settings"):
        read_toml(str(tmp_path / "absent.toml"))


def test_the_digest_does_not_depend_on_order() -> None:
    assert digest({"a": 1, "b": as_plain(Cue())}) == digest({"b": as_plain(Cue()), "a": 1})
    assert digest({"a": 1}) != digest({"a": 2})


@pytest.mark.parametrize(
    ("text", "inside", "outside", "canonical"),
    [
        (None, [0, 10**6], [], "all"),
        ("0-49", [0, 49], [50], "0-49"),
        ("3, 7-", [3, 7, 1000], [4, 6], "3,7-"),
        ("5-5", [5], [4, 6], "5"),
    ],
)
def test_frame_ranges(
    text: str | None, inside: list[int], outside: list[int], canonical: str
) -> None:
    ranges = parse_frame_ranges(text)
    assert ranges.text == canonical
    assert all(frame in ranges for frame in inside)
    assert not any(frame in ranges for frame in outside)


@pytest.mark.parametrize("text", ["9-3", "a", "1-b", "-4", "1,,2"])
def test_bad_frame_ranges_are_refused(text: str) -> None:
    with pytest.raises(SettingsError, match="--frames"):
        parse_frame_ranges(text)


def test_plug_ins_are_found_by_listing() -> None:
    assert {"kitti", "demo"} <= set(registry.names("datasets"))
    assert "kitti_tracking" in registry.names("exporters")
    assert "kitti_calibration" not in registry.names("datasets")
    assert registry.find("exporters", "kitti-tracking").__name__.endswith("kitti_tracking")


def test_a_dotted_path_is_a_plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "their_data.py").write_text("def open_dataset(root):\n    return root\n")
    (tmp_path / "their_empty.py").write_text("")
    package = tmp_path / "their"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (tmp_path / "their_data.py").rename(package / "data.py")
    (tmp_path / "their_empty.py").rename(package / "empty.py")
    monkeypatch.syspath_prepend(tmp_path)
    assert registry.find("datasets", "their.data").open_dataset("x") == "x"
    with pytest.raises(SettingsError, match=r"defines no open_dataset\(\)"):
        registry.find("datasets", "their.empty")
    with pytest.raises(SettingsError, match="cannot import"):
        registry.find("datasets", "their.absent")


def test_unknown_plug_ins_list_what_there_is() -> None:
    with pytest.raises(SettingsError, match=r"no datasets named 'kity': there are .*kitti"):
        registry.find("datasets", "kity")
