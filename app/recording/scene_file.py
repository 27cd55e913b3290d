"""A recording as one HTML file that needs nothing: viser's own player with the 3D scene inside."""

from pathlib import Path
from typing import Final

import viser

from app.console.scene import BadStateError, Scene
from app.console.viewer import silent
from app.recording.container import RecordingError
from app.recording.reader import Recording

RATE_Hz: Final = 15.0
MOST_FRAMES: Final = 1800
"""Two minutes at the full rate, about 20 MB; what is longer gets fewer frames a second."""


def write(recording: Recording, path: Path) -> Path:
    """Write the file.

    Raises:
        RecordingError: the robot's description is not known, or there is no motion.
    """
    if recording.description is None:
        raise RecordingError(f"{recording.path.name}: without the robot's description there is no scene to export")
    step_s = max(1.0 / RATE_Hz, recording.duration_s / MOST_FRAMES)
    with silent():
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        scene = Scene(server, recording.description)
        scene.start()
        serializer = server.get_scene_serializer()
        drawn, undrawn = 0, "there is none"
        frames = round(recording.duration_s / step_s)
        for frame in range(frames + 1):
            state = recording.state_at(frame * step_s)
            if state is not None:
                try:
                    scene.update(state)
                except BadStateError as bad:
                    undrawn = str(bad)
                else:
                    drawn += 1
            serializer.insert_sleep(step_s)
        if not drawn:
            raise RecordingError(f"{recording.path.name}: no state could be drawn: {undrawn}")
        path.write_text(serializer.as_html(dark_mode=True), encoding="utf-8")
    finally:
        with silent():
            server.stop()
    return path
