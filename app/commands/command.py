"""What a subcommand is, and the arguments that several of them share."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

TwinKind = Literal["default", "ideal", "none"]
RobotName = Annotated[str, tyro.conf.arg(help="Name of a robot that comes with the program, or path of a description.")]
Twin = Annotated[
    TwinKind,
    tyro.conf.arg(
        help="Physics behind simulated drives: with stretch and gravity, ideal (stiff, no gravity), or none."
    ),
]
CanLog = Annotated[
    Path | None, tyro.conf.arg(metavar="FILE", help="Write every CAN frame to FILE (.log for candump, or .blf).")
]


@dataclass(frozen=True)
class Command:
    """A subcommand. `name` may be of two words: "motors scan"."""

    name: str
    summary: str
    """One line, in lower case."""
    body: Callable[..., int]
    """Typed for tyro; returns the exit status."""
    examples: str
