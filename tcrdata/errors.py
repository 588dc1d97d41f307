"""The exceptions tcrdata raises: one base class, few names.

Every message says what is wrong, where (file, frame, column) and what to do.
"""

from __future__ import annotations


class Terminated(KeyboardInterrupt):
    """This process is asked to end, as a scheduler does: as Ctrl-C ends it, but with code 143."""


class TcrdataError(Exception):
    """Base of every error that tcrdata raises on purpose."""


class DatasetError(TcrdataError):
    """A dataset cannot be read: the root is not one, or calibration or timestamps are wrong."""


class RendererError(DatasetError):
    """A renderer that is a program of its own is missing, crashed or draws something else."""


class FrameError(DatasetError):
    """One frame cannot be read; the rest of the sequence can."""


class StoreError(TcrdataError):
    """A store cannot be opened, read or written."""


class ConflictError(StoreError):
    """Another writer has committed other content under the same name."""


class SchemaError(StoreError):
    """Rows do not fit a table's schema, or the store has another schema version."""


class RuleError(TcrdataError):
    """A rule, preset or query file is wrong: file, line and reason."""


class QueryError(TcrdataError):
    """SQL given by the user does not run."""


class SettingsError(TcrdataError):
    """A setting, preset, rule or parameter is unknown or has the wrong type."""


class MissingEvidenceError(TcrdataError):
    """A selection or score needs rows that no build has made yet."""


class EvidenceError(TcrdataError):
    """A cue cannot be measured on a sequence."""


class TrainingError(TcrdataError):
    """A training cannot go on: its loss is not a number."""
