"""One file a subcommand: its arguments, its help, its examples. What it does lives elsewhere."""
