"""Names tendons that do not do what they should: slack, slipped, broken or jammed.

What a healthy tendon should carry is known from the model. A broken one carries nothing while it should, and winding
does not bring it back. A slipped one has lost some tension at once. A jammed one answers its drive with its own
stiffness only, as if the robot behind it did not move.
"""

from cobra.control.estimation import TendonEstimate
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.mechanics.losses import Identified
from cobra.mechanics.tendon_balance import TendonBalance


class TendonHealth:
    """Watches the tendons of one robot. `faults` stay until `reset`."""

    def __init__(self, description: RobotDescription, balance: TendonBalance, identified: Identified) -> None:
        self._names = description.tendon_names
        self.reset()

    def reset(self) -> None:
        """Forget what was found."""
        self.faults: tuple[str, ...] = ()
        self.warnings: tuple[str, ...] = ()

    def observe(self, estimate: TendonEstimate, expected_N: Floats, setpoint_m: Floats, dt_s: float) -> None:
        """One tick."""
