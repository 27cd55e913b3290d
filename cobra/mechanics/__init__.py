"""Forces and motion of continuum robots, and the fitting of such models to recordings."""
