"""The link between robot processes and consoles, over Zenoh: keys, either end, and how a session is let in."""
