"""The command line: a skin over the library. Data goes to stdout, messages to stderr."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated, NoReturn

from cyclopts import App, CycloptsError, Parameter

from tcrdata import __version__
from tcrdata.errors import TcrdataError

Assignments = Annotated[tuple[str, ...], Parameter(name="--set", negative="")]
StoreUrl = Annotated[str, Parameter(name="--store")]


app = App(
    name="tcrdata",
    version=__version__,
    help="Trusted 3D labels from unlabelled video: every candidate is a row, every check is SQL.",
    help_epilogue="Every command takes --debug, which shows the traceback of an error.",
    help_format="plaintext",
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
)


@app.command
def build(
    *,
    dataset: str,
    store: StoreUrl,
    root: str = "",
    sequences: str | None = None,
    frames: str | None = None,
    rounds: int = 1,
    preset: str = "tcrdata",
    workers: int | None = None,
    config: str | None = None,
    assignments: Assignments = (),
    dry_run: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Measure the evidence of a dataset's frames into a store and select labels.

    What is done already is left as it is; a build that was stopped goes on where it was.

    Args:
        dataset: kitti, demo, street, or the dotted path of an adapter.
        store: folder or URL of the store; created when absent.
        root: where the dataset lies; generated datasets take a spec such as `seed=1,frames=50`.
        sequences: only these, with commas between.
        frames: only these of each sequence: `0-49`, `0-9,20,30-`.
        rounds: rounds of the EM loop.
        preset: presets to select labels with, with commas between, or `all`.
        workers: worker processes; the machine's cores when left out.
        config: a TOML file of settings.
        assignments: `cue.field=value` for a cue, `parameter=value` for a rule.
        dry_run: say what would be made and stop.
        json: print the report as JSON.
    """
    from tcrdata.commands import run_build

    return run_build(
        dataset=dataset,
        root=root,
        store_url=store,
        sequences=_listed(sequences),
        frames=frames,
        rounds=rounds,
        presets=_listed(preset) or (),
        workers=workers,
        config=config,
        assignments=list(assignments),
        only_plan=dry_run,
        as_json=json,
    )


@app.command
def check(
    *,
    store: StoreUrl,
    preset: str = "tcrdata",
    assignments: Assignments = (),
    name: str | None = None,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Select labels again from stored evidence; nothing is measured anew.

    Args:
        store: folder or URL of the store.
        preset: name of a preset, or the path of one.
        assignments: `parameter=value` of a rule, such as max_cycle_error_m=0.1.
        name: name of the selection; the preset's when left out.
        json: print the selection as JSON.
    """
    from tcrdata.commands import run_check

    return run_check(store, preset, list(assignments), name, as_json=json)


@app.command
def sql(
    query: str,
    *,
    store: StoreUrl,
    json: Annotated[bool, Parameter(negative="")] = False,
    csv: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Run SQL over the tables of a store.

    Args:
        query: DuckDB SQL, such as `select source, count(*) from proposals group by all`.
        store: folder or URL of the store.
        json: print the rows as a JSON array.
        csv: print the rows as CSV.
    """
    from tcrdata.commands import run_sql

    return run_sql(store, query, as_json=json, as_csv=csv)


@app.command
def evaluate(
    *,
    store: StoreUrl,
    selection: str | None = None,
    moving_only: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Score a selection's labels against ground truth.

    Args:
        store: folder or URL of the store.
        selection: name or id; the newest when left out.
        moving_only: recall and average precision on objects that move.
        json: print protocol and scores as JSON.
    """
    from tcrdata.commands import run_evaluate

    return run_evaluate(store, selection, moving_only=moving_only, as_json=json)


@app.command
def export(
    format_name: Annotated[str, Parameter(name="FORMAT")],
    *,
    store: StoreUrl,
    out: str,
    selection: str | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Write a selection's labels in another program's format.

    Args:
        format_name: kitti-tracking, or the dotted path of an exporter.
        store: folder or URL of the store.
        out: folder to write into.
        selection: name or id; the newest when left out.
        overwrite: write into a folder that is not empty.
        json: print what was written as JSON.
    """
    from tcrdata.commands import run_export

    return run_export(format_name, store, selection, out, overwrite=overwrite, as_json=json)


@app.command
def status(*, store: StoreUrl, json: Annotated[bool, Parameter(negative="")] = False) -> int:
    """List units done, failed and missing, frames left out, and rows and bytes a table.

    Args:
        store: folder or URL of the store.
        json: print as JSON.
    """
    from tcrdata.commands import run_status

    return run_status(store, as_json=json)


@app.command
def draw(
    *,
    store: StoreUrl,
    out: str,
    selection: str | None = None,
    sequence: str | None = None,
    frames: str | None = None,
    truth: bool = True,
) -> int:
    """Draw frames: the image with boxes beside the bird's-eye view coloured by free-space votes.

    Args:
        store: folder or URL of the store.
        out: folder for the PNG files.
        selection: name or id; the newest when left out.
        sequence: the first when left out.
        frames: `0,10,20`; five spread over the sequence when left out.
        truth: draw ground truth too, where there is any.
    """
    from tcrdata.commands import run_draw

    return run_draw(store, out, selection, sequence, frames, truth=truth)


@app.command
def views(*, store: StoreUrl) -> int:
    """Print `create view` statements with which any DuckDB shell reads the store.

    Args:
        store: folder of the store.
    """
    from tcrdata.commands import run_views

    return run_views(store)


@app.command
def warm() -> int:
    """Compile the numeric kernels once, so that the first build does not wait for them."""
    from tcrdata.commands import run_warm

    return run_warm()


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command; an error becomes one line on stderr and a non-zero exit."""
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in tokens
    try:
        code = app([token for token in tokens if token != "--debug"])
        sys.stdout.flush()
        sys.exit(code if isinstance(code, int) else 0)
    except CycloptsError as error:
        sys.stderr.write(f"tcrdata: {' '.join(str(error).split())} See tcrdata --help.\n")
        sys.exit(2)
    except TcrdataError as error:
        if debug:
            raise
        sys.stderr.write(f"tcrdata: {' '.join(str(error).split())}\n")
        sys.exit(1)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)
    except KeyboardInterrupt:
        sys.stderr.write("tcrdata: stopped; what is done is kept\n")
        sys.exit(130)
    except Exception as error:
        if debug:
            raise
        kind = type(error).__name__
        sys.stderr.write(
            f"tcrdata: unexpected {kind}: {' '.join(str(error).split())}; run with --debug\n"
        )
        sys.exit(70)


def _listed(text: str | None) -> tuple[str, ...] | None:
    if text is None:
        return None
    return tuple(part.strip() for part in text.split(",") if part.strip())
