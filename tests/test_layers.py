"""The layers of the package: imports point down only, heavy ones stay where they are used."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

LAYERS = (
    ("types", "errors", "resources", "frame_ranges"),
    ("geometry", "settings", "registry"),
    ("store", "reports", "networks"),
    ("datasets", "evidence", "rules", "tracking", "evaluation", "exporters", "views"),
    (
        "inspection",
        "learning",
        "pages",
        "plan",
        "outcomes",
        "ingest",
        "executors",
        "flow_evaluation",
        "flow_models",
        "dry_runs",
        "pipeline",
        "calibration",
        "rounds",
        "trainings",
        "tracked_rows",
        "tracked_scenes",
        "track_plans",
        "track_preloading",
        "track_runs",
        "tracklet_boxes",
        "track_pictures",
        "truth_starts",
        "status",
        "pictures",
        "recordings",
        "warming",
    ),
    ("plain_tables", "console", "cli", "__main__"),
)
STRANGERS = LAYERS[3]
HEAVY = {
    "cv2": {"evidence", "datasets", "geometry", "views", "learning"},
    "torch": {"networks", "learning", "evidence"},
    "matplotlib": {"views"},
    "rerun": {"views"},
    "kiss_icp": {"evidence"},
    "pypatchworkpp": {"evidence"},
    "small_gicp": {"evidence"},
    "numba": {"evidence", "geometry", "datasets", "tracking"},
    "shapely": {"geometry", "evaluation", "evidence"},
}


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def part_of(path: Path, package: Path) -> str:
    first = path.relative_to(package).parts[0]
    return first.removesuffix(".py")


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Dotted names imported anywhere in a file, but not those for type checking alone."""
    tree = parsed(path)
    typing_only = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If)
        and isinstance(node.test, ast.Name)
        and node.test.id == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if node in typing_only:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            if node.module == "tcrdata":
                found |= {f"tcrdata.{alias.name}" for alias in node.names}
    return frozenset(found)


def modules(repository: Path) -> list[Path]:
    return sorted((repository / "tcrdata").rglob("*.py"))


def test_every_part_has_a_layer(repository: Path) -> None:
    package = repository / "tcrdata"
    known = {name for layer in LAYERS for name in layer} | {"__init__"}
    assert {part_of(path, package) for path in modules(repository)} <= known


def test_imports_point_down(repository: Path) -> None:
    package = repository / "tcrdata"
    level = {name: index for index, layer in enumerate(LAYERS) for name in layer}
    wrong = []
    for path in modules(repository):
        part = part_of(path, package)
        if part == "__init__":
            continue
        for name in imports_of(path):
            if not name.startswith("tcrdata."):
                continue
            other = name.split(".")[1]
            if other in level and other != part:
                same_strangers = part in STRANGERS and other in STRANGERS
                if level[other] > level[part] or same_strangers:
                    wrong.append(f"{path.relative_to(package)} imports {name}")
    assert wrong == []


def test_no_import_circles(repository: Path) -> None:
    package = repository / "tcrdata"
    names = {
        ".".join(("tcrdata", *path.relative_to(package).with_suffix("").parts)).removesuffix(
            ".__init__"
        ): path
        for path in modules(repository)
    }
    graph = {name: top_level_imports(path, set(names)) - {name} for name, path in names.items()}
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        assert name not in path, " -> ".join((*path, name))
        if name not in done:
            for other in sorted(graph[name]):
                visit(other, (*path, name))
            done.add(name)

    for name in graph:
        visit(name, ())


def top_level_imports(path: Path, known: set[str]) -> set[str]:
    """Modules of the package that a module imports when it is imported itself."""
    found: set[str] = set()
    for node in parsed(path).body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            submodules = {f"{node.module}.{alias.name}" for alias in node.names} & known
            found |= submodules or {node.module}
    return found & known


@pytest.mark.parametrize("library", sorted(HEAVY))
def test_heavy_libraries_stay_where_they_are_used(repository: Path, library: str) -> None:
    package = repository / "tcrdata"
    users = {
        part_of(path, package)
        for path in modules(repository)
        if any(name.split(".")[0] == library for name in imports_of(path))
    }
    assert users <= HEAVY[library]


def test_help_needs_no_heavy_library() -> None:
    code = (
        "import importlib, pkgutil, sys; import tcrdata.cli as cli; "
        "names = [m.name for m in pkgutil.iter_modules(cli.__path__, 'tcrdata.cli.')]; "
        "[importlib.import_module(name) for name in names]; "
        "heavy = ['torch', 'cv2', 'numpy', 'duckdb', 'pyarrow', 'polars', 'numba', 'scipy']; "
        "print([name for name in heavy if name in sys.modules])"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


def test_only_the_store_opens_store_paths(repository: Path) -> None:
    """fsspec is used in one place, so that another kind of storage touches one place."""
    package = repository / "tcrdata"
    users = {
        path.relative_to(package).as_posix()
        for path in modules(repository)
        if any(name.split(".")[0] == "fsspec" for name in imports_of(path))
    }
    assert users == {"store/filesystem.py"}


def test_bpy_stays_in_the_process_of_the_renderer(repository: Path) -> None:
    """Its licence and its crashes are not this process's: the program is run, never imported."""
    package = repository / "tcrdata"
    program = package / "datasets" / "blender_scene.py"
    imported = {path: imports_of(path) for path in modules(repository)}
    roots = {path: {name.split(".")[0] for name in names} for path, names in imported.items()}
    assert [path for path, names in roots.items() if "bpy" in names] == [program]
    assert roots[program] - sys.stdlib_module_names == {"bpy", "mathutils", "numpy"}
    assert not any("blender_scene" in name for names in imported.values() for name in names)
