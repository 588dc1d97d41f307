"""How far the modules' confidences can be trusted, measured by one another after each round."""

from __future__ import annotations

from tcrdata import __version__, settings
from tcrdata.reports import run_report
from tcrdata.rules.rounds import rounds_read
from tcrdata.store import Store, Unit

STAGE, ANY_DATASET = "calibration", "_"


def calibrate(store: Store, round: int) -> bool:
    """Write a round's rows of `calibrations`, from the confidences of all modules.

    Args:
        store: that holds them.
        round: EM round.

    Returns:
        Whether anything was written; False when they were there for these confidences.
    """
    unit = Unit(STAGE, ANY_DATASET, f"round-{round}", round)
    files = [e for e in store.files("confidences") if e.unit.round in rounds_read(round)]
    inputs = {"confidences": settings.digest(sorted(f"{e.unit} {e.sha256}" for e in files))}
    if store.is_done(unit, __version__, inputs):
        return False
    connection = store.connect(tables=("confidences",))
    table = run_report(connection, "calibration", {"calibrated_round": round}).to_arrow_table()
    with store.writer(unit, settings_hash=__version__, inputs=inputs) as writer:
        writer.append("calibrations", {name: table[name] for name in table.column_names})
    return True
