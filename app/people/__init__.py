"""Who may come to a console, as what, and what they did there."""
