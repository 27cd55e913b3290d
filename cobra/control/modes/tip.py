"""Tip mode: the sticks move the tip in the driver's view: across it, along its line of sight, and in roll."""

import math

import numpy as np
from numpy.typing import NDArray

from cobra.control.modes.stick_frame import view_of
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED
from cobra.kinematics.resolved_rates import RateStep, ResolvedRates, tip_speed_m_s
from cobra.messages import Intent, ModeReport

Floats = NDArray[np.float64]

SAID_AFTER_S = 0.4
"""What binds for a shorter time, as every ramp does, is not worth a word."""
FALLBACK_WORDS = "the solver found no step; damped least squares moves the tip instead"


class TipMode:
    """Resolved rates under the sticks; see `Mode`."""

    def __init__(self, description: RobotDescription) -> None:
        self._resolved = ResolvedRates(description)
        self._backbone = Backbone(description)
        self._across_m_s = tip_speed_m_s(description)
        self._along_m_s = description.feed.rate_m_s if description.feed else self._across_m_s
        self._roll_rad_s = math.radians(description.twist.rate_deg_s) if description.twist else 0.0
        self.q: Floats = self._resolved.configuration.rest()
        self.velocity: Floats = np.zeros_like(self.q)
        self._step: RateStep | None = None
        self._bound_s = 0.0

    def warm_up(self) -> None:
        self._resolved.warm_up()

    def reset(self, q: Floats) -> None:
        self.q, self.velocity = q.copy(), np.zeros_like(q)
        self._step, self._bound_s = None, 0.0

    def propose(self, intent: Intent | None, dt_s: float, fed_m: float | None = None) -> tuple[Floats, Floats]:
        q = self.q.copy()
        if fed_m is not None:
            q[FEED] = fed_m
        self._step = self._resolved.step(q, self.velocity, self._wanted(intent), dt_s)
        self._bound_s = self._bound_s + dt_s if self._step.binding else 0.0
        return self._step.q, self._step.velocity

    def take(self, q: Floats, velocity: Floats) -> None:
        self.q, self.velocity = q, velocity

    def report(self) -> ModeReport:
        step = self._step
        if step is None:
            return ModeReport(fallbacks=self._resolved.fallbacks)
        failed = (FALLBACK_WORDS,) if step.solver == "damped least squares" else ()
        binding = step.binding if self._bound_s >= SAID_AFTER_S else ()
        return ModeReport(words=(*failed, *binding), share=step.scale, fallbacks=self._resolved.fallbacks)

    def _wanted(self, intent: Intent | None) -> Floats:
        """The tip's velocity in its camera's frame (6,)."""
        out = np.zeros(6)
        if intent is None:
            return out
        out[:2] = np.array(intent.primary) * self._across_m_s
        out[2] = intent.feed * self._along_m_s
        if intent.frame != "tip" and out.any():
            ends = self._backbone.section_ends(self.q)
            out[:3] = ends[-1, :3, :3].T @ view_of(intent.frame, ends) @ out[:3]
        out[5] = intent.twist * self._roll_rad_s
        return out * intent.speed
