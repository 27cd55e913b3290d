"""How one kind of pad is read: its calibration, directions and assignment, then dead zones and expo. Kept per device."""

import threading
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from app.console.inputs import Button, Controls
from app.console.mapping import Profile
from app.places import config_folder, write_private
from cobra.errors import OperatorError

Axis = Literal["left_x", "left_y", "right_x", "right_y"]
AXES: tuple[Axis, ...] = get_args(Axis)
BUTTONS: tuple[Button, ...] = get_args(Button)
Share = Annotated[float, Meta(ge=-0.5, le=0.5)]
Reach = Annotated[float, Meta(ge=0.3, le=1.0)]
DeviceName = Annotated[str, Meta(min_length=1, max_length=160)]
MAX_DEVICES = 100


class ProfileError(OperatorError):
    """A profile cannot be used. The message says what is wrong with it."""


class PadProfile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Corrections in the order in which they are applied: calibrate, invert, swap, assign; then dead zone and expo."""

    centre: tuple[Share, Share, Share, Share] = (0.0, 0.0, 0.0, 0.0)
    """Where the sticks come to rest, in the order of `AXES`."""
    reach: tuple[Reach, Reach, Reach, Reach] = (1.0, 1.0, 1.0, 1.0)
    """How far from there they go at least, towards either side."""
    invert: frozenset[Axis] = frozenset()
    swap_sticks: bool = False
    assign: dict[Button, Button] = {}
    """What is pressed → what it does, where they differ. Together an exchange: nothing can be left without its button."""
    shape: Profile = Profile()

    def check(self) -> None:
        """Nothing that is needed may get lost: STOP and the dead-man least of all.

        Raises:
            ProfileError: two buttons do the same, or one does nothing any more.
        """
        done = {button: self.assign.get(button, button) for button in BUTTONS}
        missing = sorted(set(BUTTONS) - set(done.values()))
        if missing:
            raise ProfileError(f"no button would do what {' and '.join(missing)} did: exchange buttons in pairs")


AS_BUILT = PadProfile()


def corrected(controls: Controls, profile: PadProfile) -> Controls:
    """One reading as the profile says; the shape (dead zone, expo) is applied where it is mapped to motion."""
    if profile is AS_BUILT:
        return controls
    raw = (*controls.left, *controls.right)
    axes = [
        (min(1.0, max(-1.0, (value - centre) / reach)) if abs(value) <= 1.001 else value)
        * (-1.0 if name in profile.invert else 1.0)
        for name, value, centre, reach in zip(AXES, raw, profile.centre, profile.reach, strict=True)
    ]
    left, right = (axes[0], axes[1]), (axes[2], axes[3])
    if profile.swap_sticks:
        left, right = right, left
    buttons = frozenset(profile.assign.get(button, button) for button in controls.buttons)
    return replace(controls, left=left, right=right, buttons=buttons)


class PadProfiles:
    """The profiles of all devices, in one file. Safe from any thread."""

    def __init__(self, path: Path | None = None) -> None:
        self._path = path or config_folder() / "pads.json"
        self._lock = threading.Lock()
        self._profiles: dict[str, PadProfile] = {}

    def start(self) -> None:
        """Read the file.

        Raises:
            ProfileError: it is there and cannot be used.
        """
        try:
            self._profiles = msgspec.json.decode(self._path.read_bytes(), type=dict[str, PadProfile])
            for profile in self._profiles.values():
                profile.check()
        except FileNotFoundError:
            self._profiles = {}
        except (OSError, msgspec.MsgspecError, ProfileError) as error:
            raise ProfileError(f"{self._path}: is no file of pad profiles: {error}; mend or remove it") from None

    def of(self, device: str) -> PadProfile:
        return self._profiles.get(device, AS_BUILT)

    def all(self) -> dict[str, PadProfile]:
        return dict(self._profiles)

    def put(self, device: str, profile: PadProfile) -> None:
        """Keep a profile, for this device from now on.

        Raises:
            ProfileError: see `PadProfile.check`; or there are too many devices.
        """
        profile.check()
        with self._lock:
            changed = {**self._profiles, device: profile}
            if len(changed) > MAX_DEVICES:
                raise ProfileError(f"{self._path} holds {MAX_DEVICES} devices already: remove some")
            write_private(self._path, msgspec.json.format(msgspec.json.encode(changed), indent=1) + b"\n")
            self._profiles = changed
