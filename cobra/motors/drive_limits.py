"""A drive's temperature and supply against the limits of its motor, in words."""

from cobra.description import Motor


def beyond_limits(motor: Motor, celsius: float, volts: float) -> tuple[str, ...]:
    """What is out of bounds; NaN, not read yet, is not."""
    words = []
    if celsius > motor.max_temperature_C:
        words.append(f"{celsius:g} °C, at most {motor.max_temperature_C:g}")
    if volts < motor.min_voltage_V or volts > motor.max_voltage_V:
        words.append(f"{volts:g} V, must be {motor.min_voltage_V:g} to {motor.max_voltage_V:g}")
    return tuple(words)
