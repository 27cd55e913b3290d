"""`python -m app` is `cobra-teleop`."""

from app.cli import main

main()
