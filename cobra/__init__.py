"""Tendon-driven continuum robots: description, kinematics, mechanics, motors, control and a physics twin. No screen, no network."""
