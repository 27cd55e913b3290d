"""What the driver may ask of the motion apart from moving: save and delete poses, tell the length fed by hand."""

from collections.abc import Callable

from cobra.control.motion import Motion
from cobra.control.poses import PoseBook
from cobra.control.requests import Act
from cobra.control.supervisor import Health, Supervisor
from cobra.messages import Reply, Request


def motion_acts(motion: Motion, poses: PoseBook, supervisor: Supervisor) -> dict[str, Act]:
    """save_pose (name), delete_pose (name), hand_feed (value [m])."""

    def save(request: Request) -> str:
        if not supervisor.homed:
            return "the shape is not known before homing: arm and home it first"
        return poses.save(request.name, motion.q)

    def act(carry_out: Callable[[Request], str]) -> Act:
        def answer(request: Request, now_s: float, health: Health) -> Reply:
            if supervisor.phase == "driving":
                return Reply(ok=False, reasons=("let go first: the robot is being driven",))
            refusal = carry_out(request)
            return Reply(ok=not refusal, reasons=(refusal,) if refusal else ())

        return answer

    return {
        "save_pose": act(save),
        "delete_pose": act(lambda request: poses.delete(request.name)),
        "hand_feed": act(lambda request: motion.hand_feed.tell(request.value)),
    }
