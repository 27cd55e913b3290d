"""People and machines around the robot: command line, link between processes, console and recordings."""
