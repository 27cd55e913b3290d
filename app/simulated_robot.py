"""A robot whose described buses are simulated, each robot in a world of its own."""

import msgspec

from cobra.description import Bus, RobotDescription
from cobra.loading import load_description
from cobra.motors.open_bus import SIMULATED
from cobra.simulation.options import Simulation


def simulated(robot: str, simulation: Simulation) -> RobotDescription:
    """The description, with its simulated buses led to this robot's own world, simulated as wanted.

    Raises:
        DescriptionError: as `load_description`.
    """
    description = load_description(robot)

    def chosen(bus: Bus) -> Bus:
        if bus.interface != SIMULATED:
            return bus
        return msgspec.structs.replace(
            bus, channel=f"{robot}#{bus.name}", options={**simulation.bus_options(), **bus.options}
        )

    return msgspec.structs.replace(description, buses=tuple(chosen(bus) for bus in description.buses))


def is_simulated(description: RobotDescription) -> bool:
    """Whether all its buses are simulated in this process."""
    return all(bus.interface == SIMULATED for bus in description.buses)
