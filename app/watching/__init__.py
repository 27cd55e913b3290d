"""Read-only consoles: one page a robot, and a wall of them all."""
