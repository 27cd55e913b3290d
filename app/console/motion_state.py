"""The motion's report and the modes' guides, as the page gets them."""

import math

from app.console.guides import Guide
from app.console.mapping import Selection
from app.console.page_state import GuideState, HandFeedState, LineState, MotionState, PathState
from cobra.messages import RobotState


def guide_state(guide: Guide) -> GuideState:
    return GuideState(
        name=guide.name,
        title=guide.title,
        help=guide.help,
        left=guide.left,
        right=guide.right,
        feed=guide.feed,
        twist=guide.twist,
        lines=[LineState(pad=line.pad, keys=line.keys, does=line.does) for line in guide.lines],
    )


def motion_state(state: RobotState | None, chosen: Selection) -> MotionState:
    """Of the newest state; what the robot says of another mode than the chosen one is left out."""
    if state is None:
        return MotionState(words=[], share=1.0, fallbacks=0, path=None, poses=[], pose="", hand_feed=None)
    motion = state.motion
    doing, path, fed = motion.doing, motion.doing.path, motion.hand_feed
    present = state.mode == chosen.mode
    return MotionState(
        words=list(doing.words) if present else [],
        share=_number(doing.share),
        fallbacks=doing.fallbacks,
        path=PathState(
            deviation_mm=_number(path.deviation_m * 1e3),
            deviation_max_mm=_number(path.deviation_max_m * 1e3),
            length_mm=_number(path.length_m * 1e3),
        )
        if path and present
        else None,
        poses=list(motion.poses),
        pose=chosen.pose if chosen.pose in motion.poses else "",
        hand_feed=HandFeedState(told_mm=_number(fed.told_m * 1e3), used_mm=_number(fed.used_m * 1e3), source=fed.source)
        if fed
        else None,
    )


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
