"""Kinematics of piecewise-constant-curvature robots in bend vectors."""
