"""What stands in for hardware: drives that answer real frames, and a physics twin that they pull."""
