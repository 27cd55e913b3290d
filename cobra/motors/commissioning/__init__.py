"""From a bare bus to a homed robot: procedures that move drives a little, watched by a guard that ends them with the reason.

A procedure is stepped once a tick, by the robot process (`cobra.control.commissioning`) or alone on a bus (`bench`).
"""
