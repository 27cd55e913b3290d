"""Where the pad set-up page reads profiles and applies them: `/pads`. Applying is refused while the robot is armed."""

from collections.abc import Callable, Sequence

import msgspec
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from app.console.doorkeeper import PRESENT
from app.console.pad_profile import DeviceName, PadProfile, PadProfiles, ProfileError
from app.people.roles import at_least

MAX_BYTES = 8192


class _Applied(msgspec.Struct, forbid_unknown_fields=True):
    device: DeviceName
    profile: PadProfile


def pad_routes(profiles: PadProfiles, armed: Callable[[], bool]) -> Sequence[BaseRoute]:
    """`armed`: whether the drives may be on, or it is not known that they are off."""

    async def read(request: Request) -> Response:
        return JSONResponse(msgspec.to_builtins(profiles.all()))

    async def apply(request: Request) -> Response:
        visitor = request.scope[PRESENT]()
        if visitor is None or not at_least(visitor.role, "driver"):
            return _answer("only a driver may set up pads", 403)
        if armed():
            return _answer(
                "the robot is armed: disarm it first, so that no stick changes its meaning under a hand", 409
            )
        body = b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > MAX_BYTES:
                return _answer("that is too long for a profile", 413)
        try:
            wanted = msgspec.json.decode(body, type=_Applied)
            profiles.put(wanted.device, wanted.profile)
        except (msgspec.MsgspecError, ProfileError, RecursionError) as error:
            return _answer(str(error), 400)
        except OSError as error:
            return _answer(f"the profile could not be kept: {error.strerror}", 500)
        return _answer("", 200)

    return (Route("/pads", read), Route("/pads", apply, methods=["POST"]))


def _answer(refusal: str, status: int) -> JSONResponse:
    return JSONResponse({"ok": not refusal, "reasons": [refusal] if refusal else []}, status)
