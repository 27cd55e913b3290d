"""Recordings: write, read, export."""
