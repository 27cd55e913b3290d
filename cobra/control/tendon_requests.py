"""What the driver may ask of the tendons: compensation on or off, another pretension, other loss parameters."""

from cobra.control.requests import Act
from cobra.control.setpoints import Setpoints
from cobra.control.supervisor import Health, Supervisor
from cobra.control.tendon_control import TendonControl
from cobra.mechanics.losses import LossesError, from_text
from cobra.messages import Reply, Request


def tendon_acts(tendons: TendonControl, setpoints: Setpoints, supervisor: Supervisor) -> dict[str, Act]:
    """compensation (value 1 or 0), pretension (value [N]), parameters (TOML in `name`)."""

    def compensation(request: Request, now_s: float, health: Health) -> Reply:
        """Bumpless: the difference is taken up while driving."""
        if not tendons.available:
            return Reply(ok=False, reasons=("this robot has no tendons that could be compensated",))
        tendons.enabled = request.value != 0.0
        setpoints.retake()
        return Reply(ok=True)

    def pretension(request: Request, now_s: float, health: Health) -> Reply:
        if supervisor.phase != "ready":
            return Reply(ok=False, reasons=("arm and home it first, and let go of the drive button",))
        refused = tendons.tighten(request.value)
        return Reply(ok=not refused, reasons=(refused,) if refused else ())

    def parameters(request: Request, now_s: float, health: Health) -> Reply:
        """They count from the next homing on."""
        if supervisor.phase not in ("disarmed", "ready", "holding"):
            return Reply(ok=False, reasons=("not while it moves or is stopped",))
        try:
            tendons.prepare(from_text(request.name, tendons.description, "the parameters"))
        except LossesError as error:
            return Reply(ok=False, reasons=(str(error),))
        return Reply(ok=True)

    return {"compensation": compensation, "pretension": pretension, "parameters": parameters}
