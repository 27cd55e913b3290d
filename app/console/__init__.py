"""The console: pad, pages and 3D scene."""
