"""Whether a description's losses and load cells can be those of a real robot; each complaint is one line with the reason."""

import math

from cobra.description import LoadCell, RobotDescription, Tendon

MAX_FRICTION = 1.0
"""Dry metal on metal stays below; above it a single turn of conduit would hold a tendon for good."""
MAX_CAPSTAN = 3.0
"""Conduit friction times its bends: exp(−3) leaves one newton in twenty."""
MODULUS_RANGE_Pa = (1e8, 1.2e12)
"""From a soft polymer to diamond."""
MAX_BACKLASH_DEG = 20.0
MAX_RUNOUT = 0.25
"""Of the spool's radius."""
MAX_FRAME_BYTES = 8
RMD_IDS = (range(0x140, 0x161), range(0x240, 0x261))
"""Requests and replies of the drives."""


def implausible(d: RobotDescription) -> list[str]:
    """What contradicts physics, one line a number: key, value, reason."""
    return [
        *(_tendon(d.tendon) if d.tendon else []),
        *_drives(d),
        *(line for i in range(len(d.load_cells)) for line in _load_cell(d, i)),
    ]


def _tendon(tendon: Tendon) -> list[str]:
    out = []
    low, high = MODULUS_RANGE_Pa
    modulus = tendon.youngs_modulus_Pa
    if not low <= modulus <= high:
        out.append(
            f"tendon.axial_stiffness_N = {tendon.axial_stiffness_N:g}: with diameter_m = {tendon.diameter_m:g} the material "
            f"would have a Young's modulus of {modulus / 1e9:.3g} GPa; must be {low / 1e9:g} to {high / 1e9:g} GPa"
        )
    for key in ("hole_friction", "conduit_friction"):
        if getattr(tendon, key) > MAX_FRICTION:
            out.append(
                f"tendon.{key} = {getattr(tendon, key):g}: a coefficient of friction; must be at most {MAX_FRICTION:g}"
            )
    if tendon.conduit_bend_deg and not tendon.conduit_length_m:
        out.append(
            f"tendon.conduit_bend_deg = {tendon.conduit_bend_deg:g}: a conduit of conduit_length_m = 0 cannot bend"
        )
    if (capstan := tendon.conduit_friction * tendon.conduit_bend_rad) > MAX_CAPSTAN:
        out.append(
            f"tendon.conduit_bend_deg = {tendon.conduit_bend_deg:g}: with conduit_friction = {tendon.conduit_friction:g} "
            f"the conduit would lose the factor exp({capstan:.1f}) of the tension and the tendon be stuck; "
            f"must be at most exp({MAX_CAPSTAN:g})"
        )
    return out


def _drives(d: RobotDescription) -> list[str]:
    out = [
        f"motors[{i}].backlash_deg = {motor.backlash_deg:g}: no drive with so much play can be positioned; "
        f"must be at most {MAX_BACKLASH_DEG:g}"
        for i, motor in enumerate(d.motors)
        if motor.backlash_deg > MAX_BACKLASH_DEG
    ]
    for i, drive in enumerate(d.drives):
        key = f"drives[{i}]"
        if drive.moves != "tendon" and (drive.spool_runout_m or drive.winds_over):
            out.append(f"{key}: spool_runout_m and winds_over are for the spool of a tendon")
        elif drive.spool_radius_m and drive.spool_runout_m > MAX_RUNOUT * drive.spool_radius_m:
            out.append(
                f"{key}.spool_runout_m = {drive.spool_runout_m:g}: must be at most {MAX_RUNOUT:g} of "
                f"spool_radius_m = {drive.spool_radius_m:g}"
            )
        if drive.winds_over and d.tendon and drive.spool_radius_m:
            turns = (drive.travel_limits[1] - drive.travel_limits[0]) / (math.tau * drive.spool_radius_m)
            if turns * d.tendon.diameter_m > drive.spool_radius_m / 2:
                out.append(
                    f"{key}.winds_over = true: over its travel_range the tendon would wind {turns:.0f} layers of "
                    f"{d.tendon.diameter_m:g} m on a spool of {drive.spool_radius_m:g} m; at most half its radius"
                )
    return out


def _load_cell(d: RobotDescription, index: int) -> list[str]:
    cell, key = d.load_cells[index], f"load_cells[{index}]"
    out = []
    if cell.tendon not in d.tendon_names:
        out.append(f"{key}.tendon = {cell.tendon!r}: no such tendon; the sections name {', '.join(d.tendon_names)}")
    if cell.bus not in (names := sorted(bus.name for bus in d.buses)):
        out.append(f"{key}.bus = {cell.bus!r}: no such bus; described are {', '.join(names)}")
    if any(drive.bus == cell.bus for drive in d.drives) and any(cell.frame_id in ids for ids in RMD_IDS):
        out.append(
            f"{key}.frame_id = 0x{cell.frame_id:X}: the drives on bus {cell.bus!r} use 0x140 to 0x160 and 0x240 to 0x260"
        )
    if cell.byte_offset + cell.size > MAX_FRAME_BYTES:
        out.append(
            f"{key}.byte_offset = {cell.byte_offset}: {cell.type} needs {cell.size} bytes and a frame has "
            f"{MAX_FRAME_BYTES}; must be at most {MAX_FRAME_BYTES - cell.size}"
        )
    for i, other in enumerate(d.load_cells[:index]):
        if other.tendon == cell.tendon:
            out.append(f"{key}.tendon = {cell.tendon!r}: load_cells[{i}] measures it already")
        if (other.bus, other.frame_id) == (cell.bus, cell.frame_id):
            out += _shared_frame(cell, other, key, i)
    return out


def _shared_frame(cell: LoadCell, other: LoadCell, key: str, i: int) -> list[str]:
    out = []
    if cell.byte_offset < other.byte_offset + other.size and other.byte_offset < cell.byte_offset + cell.size:
        out.append(f"{key}.byte_offset = {cell.byte_offset}: overlaps load_cells[{i}] in frame 0x{cell.frame_id:X}")
    if cell.rate_Hz != other.rate_Hz:
        out.append(f"{key}.rate_Hz = {cell.rate_Hz:g}: load_cells[{i}] sends the same frame at {other.rate_Hz:g} Hz")
    return out
