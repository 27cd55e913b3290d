"""What `cobra-teleop identify …` does: read a CSV, fit, tell in words what is known, write numbers and pictures."""
