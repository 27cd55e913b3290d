"""Colours and light of the console: one palette for the 3D view, its bars and its plots."""

import numpy as np
import viser
from numpy.typing import NDArray

from app.console.meshes import Floats

Colors = NDArray[np.uint8]
Rgb = tuple[int, int, int]

TUBE: Rgb = (40, 46, 54)
VERTEBRA: Rgb = (152, 160, 170)
COLLAR: Rgb = (104, 120, 204)
"""The ends of the sections stand out a little."""
RIGID: Rgb = (214, 160, 72)
"""Guiders that have locked."""
HEAD: Rgb = (160, 167, 176)
AXES: tuple[Rgb, Rgb, Rgb] = ((232, 84, 76), (98, 200, 104), (84, 140, 250))
"""x, y, z."""
VIEW_CONE: Rgb = (255, 190, 70)
PLATE: Rgb = (58, 66, 77)
INTRODUCER: Rgb = (46, 53, 62)
BOLT: Rgb = (112, 119, 128)
WALL: Rgb = (64, 92, 116)
WALL_NEAR, WALL_FAR = 0.05, 0.30
"""Opacity of walls seen from outside, which stand before the robot, and from inside, which stand behind it."""
BLADE: Rgb = (58, 66, 78)
SIMULATED: Rgb = (255, 214, 178)
"""Where the simulation knows the body to be, where that is not what the motors say."""
CONTACT: Rgb = (255, 128, 40)
TWIN: Rgb = (232, 120, 190)
"""What only the twin knows: where it really is."""
PUSH: Rgb = (255, 214, 90)
PREDICTED: Rgb = (150, 226, 120)
GHOST: Rgb = (24, 136, 236)
PATH: Rgb = (255, 214, 96)
"""What the body is to follow."""
TARGET: Rgb = (120, 214, 160)
"""The shape that it goes to."""
REACH_NEAR: Rgb = (60, 96, 140)
REACH_FAR: Rgb = (130, 220, 190)
TRAIL: Rgb = (96, 196, 255)
STALE: Rgb = (84, 86, 90)
"""Of a robot whose shape is old or not known."""
NOTICE: Rgb = (255, 206, 120)
GLOW: Rgb = (46, 58, 72)
"""The background behind the robot; what fades, fades into this."""
DEPTH: Rgb = (20, 26, 34)
"""The background elsewhere."""
ACCENT: Rgb = (64, 150, 224)

_TENSION_STOPS = (
    (0.0, (56, 100, 224)),
    (0.12, (64, 150, 220)),
    (0.40, (72, 196, 150)),
    (0.72, (236, 180, 64)),
    (1.0, (236, 62, 52)),
)
"""Share of the limit → colour: cool when slack, calm in range, amber and red towards the limit.
Red never falls and blue never rises along the ramp."""

SERIES_COLORS: tuple[Rgb, ...] = (
    (94, 170, 245),
    (120, 214, 160),
    (250, 190, 90),
    (240, 120, 120),
    (186, 150, 250),
    (110, 220, 226),
    (240, 150, 206),
    (196, 206, 110),
    (160, 176, 200),
    (214, 160, 120),
    (140, 240, 120),
    (255, 230, 150),
)


def tension_colors(tensions: Floats, max_tension_N: float) -> Colors:
    """Colours (n, 3) of tensions (n,) [N]; grey where a tension is not known."""
    share = np.clip(tensions / max_tension_N, 0.0, 1.0)
    places = np.array([place for place, _ in _TENSION_STOPS])
    colors = np.array([color for _, color in _TENSION_STOPS], dtype=float)
    ramp = np.stack([np.interp(share, places, channel) for channel in colors.T], axis=-1)
    return np.where(np.isfinite(tensions)[:, None], ramp, STALE).round().astype(np.uint8)


def linear(colors: Colors | Rgb) -> Colors:
    """The same colours for lines and instances, whose colours viser 1.1 hands to the shader as linear light."""
    return np.round(255.0 * (np.asarray(colors) / 255.0) ** 2.2).astype(np.uint8)


def fading(color: Rgb, count: int) -> Colors:
    """`count` colours (count, 3) from the background to `color`."""
    share = np.linspace(0.0, 1.0, count)[:, None] ** 1.5
    return np.round((1.0 - share) * np.array(GLOW) + share * np.array(color)).astype(np.uint8)


def hex_color(color: Rgb | Colors) -> str:
    """As CSS writes it."""
    red, green, blue = (int(channel) for channel in color)
    return f"#{red:02x}{green:02x}{blue:02x}"


def background(width: int = 480, height: int = 300) -> Colors:
    """A calm gradient (height, width, 3), brighter behind the robot, dithered so that it shows no bands."""
    y, x = np.linspace(0.0, 1.0, height)[:, None], np.linspace(-1.0, 1.0, width)[None, :]
    glow = np.exp(-((x / 0.9) ** 2) - ((y - 0.36) / 0.42) ** 2)
    share = ((0.2 + 0.8 * glow) * (1.0 - 0.35 * y))[..., None]
    noise = np.random.default_rng(1).uniform(0.0, 1.0, (height, width, 1))
    return np.floor(share * np.array(GLOW) + (1.0 - share) * np.array(DEPTH) + noise).astype(np.uint8)


def light(server: viser.ViserServer) -> None:
    """The panels of a studio all around, one lamp above that casts soft shadows, and a calm background."""
    server.scene.configure_environment_map("studio", environment_intensity=0.45)
    server.scene.configure_default_lights(enabled=True, cast_shadow=True)
    server.scene.set_background_image(background(), format="png")
