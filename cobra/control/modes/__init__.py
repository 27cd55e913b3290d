"""The ways to move the robot, one file each, chosen by `Command.mode`. `motion.py` switches between them."""
