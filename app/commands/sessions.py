"""`cobra-teleop sessions`: what has been recorded."""

from datetime import date
from pathlib import Path
from typing import Annotated

import tyro

from app.commands.command import Command, RecordFolder

Name = Annotated[
    str, tyro.conf.Positional, tyro.conf.arg(metavar="SESSION", help="Name of a session, as the list shows it.")
]


def sessions(
    *,
    text: Annotated[str, tyro.conf.arg(help="Words in name, robot, driver, alarm or note.")] = "",
    since: Annotated[date | None, tyro.conf.arg(metavar="YYYY-MM-DD", help="From this day on.")] = None,
    until: Annotated[date | None, tyro.conf.arg(metavar="YYYY-MM-DD", help="Up to this day.")] = None,
    robot: Annotated[str, tyro.conf.arg(help="Only of this robot.")] = "",
    driver: Annotated[str, tyro.conf.arg(help="Only where this person drove.")] = "",
    alarm: Annotated[str, tyro.conf.arg(help="Only with an alarm of these words.")] = "",
    alarms: Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="Only with an alarm.")] = False,
    marked: Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="Only marked ones.")] = False,
    record: RecordFolder = None,
) -> int:
    from rich.console import Console
    from rich.table import Table

    from app.recording import catalogue, storage

    folder = record or storage.default_folder()
    search = catalogue.Search(
        text=text,
        since=since,
        until=until,
        robot=robot,
        driver=driver,
        alarm=alarm,
        alarms_only=alarms,
        marked_only=marked,
    )
    found = catalogue.sessions(folder, search)
    if not found:
        print(f"no such session in {folder}")
        return 0
    table = Table("session", "length", "robot", "drivers", "alarms", "size", "note", box=None, header_style="dim")
    table.columns[0].no_wrap = True
    for row in catalogue.table(found):
        table.add_row(*row)
    Console().print(table)
    return 0


def mark(
    session: Name,
    /,
    *,
    off: Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="Take the mark away.")] = False,
    record: RecordFolder = None,
) -> int:
    from app.recording import catalogue

    catalogue.mark(_find(session, record), not off)
    return 0


def note(
    session: Name,
    text: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TEXT", help="The note; empty takes it away.")],
    /,
    *,
    record: RecordFolder = None,
) -> int:
    from app.recording import catalogue

    catalogue.annotate(_find(session, record), text)
    return 0


def delete(session: Name, /, *, record: RecordFolder = None) -> int:
    from app.recording import catalogue

    catalogue.delete(_find(session, record))
    return 0


def _find(name: str, folder: Path | None) -> Path:
    from app.recording import catalogue, storage

    return catalogue.find(folder or storage.default_folder(), name)


COMMANDS = (
    Command(
        "sessions",
        "list and search what was recorded",
        sessions,
        "  cobra-teleop sessions\n"
        "  cobra-teleop sessions --since 2026-11-01 --driver ada --alarms\n"
        '  cobra-teleop sessions --alarm "no answer"',
    ),
    Command(
        "sessions mark",
        "keep a session for good, whatever room is needed",
        mark,
        "  cobra-teleop sessions mark 2026-11-22_07-26-37_cobra\n"
        "  cobra-teleop sessions mark 2026-11-22_07-26-37_cobra --off",
    ),
    Command(
        "sessions note",
        "write a note to a session",
        note,
        '  cobra-teleop sessions note 2026-11-22_07-26-37_cobra "stuck at blade 7"',
    ),
    Command(
        "sessions delete",
        "delete a session with all that belongs to it",
        delete,
        "  cobra-teleop sessions delete 2026-11-22_07-26-37_cobra",
    ),
)
