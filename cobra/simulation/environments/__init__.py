"""What surrounds a simulated robot: pipes, an engine's stage, or a mesh of the user's own."""

from cobra.simulation.environments.choose import environment
from cobra.simulation.environments.surface import Environment, WallsError

__all__ = ["Environment", "WallsError", "environment"]
