"""What a call does, for whoever looks for a fault: Python's `logging`, silent unless asked for.

Each module logs under its own name.  Processes that a process starts log as it does, into one file.
"""

import logging
import os

from shared_model.errors import UserError

# The environment of child processes: level, and the file; empty: standard error.
LEVEL_VARIABLE, FILE_VARIABLE = "RISORIUS_LOG_LEVEL", "RISORIUS_LOG_FILE"
FORMAT = "%(asctime)s.%(msecs)03d %(process)d %(levelname)s %(name)s: %(message)s"
TIME_FORMAT = "%H:%M:%S"
# Libraries that log much of themselves.
QUIET_LIBRARIES = ("asyncio", "distributed", "numba")


def log_to(level: int, path: str | None) -> None:
    """Log from a level on, `logging.INFO` and the like, into a file, or to standard error.

    Raises `UserError` if the file cannot be written.
    """
    os.environ[LEVEL_VARIABLE], os.environ[FILE_VARIABLE] = str(level), path or ""
    follow_environment()


def follow_environment() -> None:
    """Log as the process that has started this one.  Raises `UserError` as `log_to` does."""
    level = os.environ.get(LEVEL_VARIABLE)
    if level is None:
        return
    path = os.environ.get(FILE_VARIABLE)
    try:
        handler = logging.FileHandler(path, encoding="utf-8") if path else logging.StreamHandler()
    except OSError as error:
        raise UserError(f"cannot write the log {path}: {error.strerror}") from error
    handler.setFormatter(logging.Formatter(FORMAT, TIME_FORMAT))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(int(level))
    for name in QUIET_LIBRARIES:
        logging.getLogger(name).setLevel(logging.WARNING)
