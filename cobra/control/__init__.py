"""From an operator's intent to motor setpoints: supervisor, motion, limits and the fixed-rate loop."""
