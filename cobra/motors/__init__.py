"""Motors on a CAN bus: one interface, several protocols."""
