"""Losses and speed of a training as TensorBoard reads them: beside the store, never in it."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Any

from tcrdata.errors import SettingsError

if TYPE_CHECKING:
    from tcrdata.learning.training import Report


class EventLogs:
    """Event files of one training in a folder; a folder a training keeps its curves apart."""

    def __init__(self, folder: str) -> None:
        """Write nothing yet.

        Raises:
            SettingsError: the package that writes the format is not installed.
        """
        try:
            from tensorboardX import SummaryWriter
        except ModuleNotFoundError as error:
            if error.name != "tensorboardX":
                raise
            raise SettingsError(
                "--logs needs the package tensorboardX: pip install 'tcrdata[logs]'"
            ) from error
        self._folder, self._make = folder, SummaryWriter
        self._writer: Any = None

    def __enter__(self) -> EventLogs:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._writer is not None:
            self._writer.close()

    def add(self, report: Report) -> None:
        """Write a step's loss, its parts, the learning rate and the frames a second.

        Raises:
            SettingsError: the folder cannot be written to.
        """
        if self._writer is None:
            # Steps that an earlier run wrote before it was killed are done again.
            try:
                self._writer = self._make(self._folder, purge_step=report.step)
            except OSError as error:
                raise SettingsError(f"--logs {self._folder}: {error.strerror}") from error
        values = {
            "loss": report.loss,
            **{f"loss/{name}": value for name, value in report.terms.items()},
            "learning_rate": report.learning_rate,
            "frames_per_s": report.frames_per_s,
        }
        for name, value in values.items():
            self._writer.add_scalar(name, value, report.step)
