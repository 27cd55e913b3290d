"""Where the program keeps what outlives it: each user's own folders, as the XDG base directories name them."""

import os
import tempfile
from pathlib import Path


def config_folder() -> Path:
    """For what people decide: users, pad profiles. Made when missing, for its owner only."""
    return _made(os.environ.get("COBRA_TELEOP_CONFIG_DIR"), "XDG_CONFIG_HOME", ".config")


def state_folder() -> Path:
    """For what the program writes down: the audit trail. Made when missing, for its owner only."""
    return _made(os.environ.get("COBRA_TELEOP_STATE_DIR"), "XDG_STATE_HOME", ".local/state")


def data_folder() -> Path:
    """For what people make with it: saved poses. Not made here: whoever has something to keep makes it."""
    return _place(os.environ.get("COBRA_TELEOP_DATA_DIR"), "XDG_DATA_HOME", ".local/share")


def write_private(path: Path, data: bytes) -> None:
    """Replace a file at once, readable and writable for its owner only."""
    handle, fresh = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # made with mode 0600
    with os.fdopen(handle, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    Path(fresh).replace(path)


def _made(named: str | None, variable: str, usual: str) -> Path:
    path = _place(named, variable, usual)
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    return path


def _place(named: str | None, variable: str, usual: str) -> Path:
    base = os.environ.get(variable)
    return Path(named) if named else (Path(base) if base else Path.home() / usual) / "cobra-teleop"
