"""The bytes of the RMD protocol, from the vendor's documents V1.61 and V3.9, not from our own encoder."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobra.motors.rmd import (
    DIALECTS,
    RMD_V1,
    RMD_V3,
    Dialect,
    Request,
    decode,
    decode_request,
    encode,
    encode_reply,
    fault_words,
    model_text,
)
from cobra.motors.rmd_channel import outgoing

REQUESTS = [
    (RMD_V3, "position", {"speed_dps": 500, "angle_deg": 360.0}, "A4 00 F4 01 A0 8C 00 00"),
    (RMD_V3, "position", {"speed_dps": 500, "angle_deg": -360.0}, "A4 00 F4 01 60 73 FF FF"),
    (RMD_V3, "speed", {"speed_dps": 100.0}, "A2 00 00 00 10 27 00 00"),
    (RMD_V3, "torque", {"current": -100}, "A1 00 00 00 9C FF 00 00"),
    (RMD_V3, "watchdog", {"timeout_ms": 1000}, "B3 00 00 00 E8 03 00 00"),
    (RMD_V3, "write_acceleration", {"index": 1, "acceleration_dps2": 10000}, "43 01 00 00 10 27 00 00"),
    (RMD_V3, "read_acceleration", {"index": 1}, "42 01 00 00 00 00 00 00"),
    (RMD_V3, "zero_encoder", {}, "64 00 00 00 00 00 00 00"),
    (RMD_V3, "restart", {}, "76 00 00 00 00 00 00 00"),
    (RMD_V1, "speed", {"speed_dps": 90.0}, "A2 00 00 00 28 23 00 00"),
    (RMD_V1, "position", {"speed_dps": 500, "angle_deg": -360.0}, "A4 00 F4 01 60 73 FF FF"),
    (RMD_V1, "torque", {"current": 2000}, "A1 00 00 00 D0 07 00 00"),
    (RMD_V1, "write_acceleration", {"acceleration_dps2": 1000}, "34 00 00 00 E8 03 00 00"),
    (RMD_V1, "write_encoder_offset", {"offset": 0x2BCD}, "91 00 00 00 00 00 CD 2B"),
    (RMD_V1, "zero_encoder", {}, "19 00 00 00 00 00 00 00"),
    (RMD_V1, "status_1", {}, "9A 00 00 00 00 00 00 00"),
    (RMD_V1, "status_2", {}, "9C 00 00 00 00 00 00 00"),
    (RMD_V1, "status_3", {}, "9D 00 00 00 00 00 00 00"),
    (RMD_V1, "off", {}, "80 00 00 00 00 00 00 00"),
    (RMD_V1, "stop", {}, "81 00 00 00 00 00 00 00"),
    (RMD_V1, "run", {}, "88 00 00 00 00 00 00 00"),
    (RMD_V1, "position_full_speed", {"angle_deg": 360.0}, "A3 00 00 00 A0 8C 00 00"),
    (RMD_V1, "single_turn_position_full_speed", {"direction": 1, "angle_deg": 359.99}, "A5 01 00 00 9F 8C 00 00"),
    (RMD_V1, "single_turn_position", {"direction": 0, "speed_dps": 500, "angle_deg": 90.0}, "A6 00 F4 01 28 23 00 00"),
    (RMD_V3, "single_turn_position", {"direction": 1, "speed_dps": 500, "angle_deg": 90.0}, "A6 01 F4 01 28 23 00 00"),
    (RMD_V3, "increment", {"speed_dps": 500, "angle_deg": -180.0}, "A8 00 F4 01 B0 B9 FF FF"),
    (RMD_V3, "model", {}, "B5 00 00 00 00 00 00 00"),
    (RMD_V3, "version", {}, "B2 00 00 00 00 00 00 00"),
    (RMD_V3, "uptime", {}, "B1 00 00 00 00 00 00 00"),
]


@pytest.mark.parametrize(("dialect", "request_name", "values", "text"), REQUESTS)
def test_requests_have_the_vendors_bytes(dialect: Dialect, request_name: Request, values: dict, text: str) -> None:
    assert encode(dialect, request_name, **values) == bytes.fromhex(text)
    assert decode_request(dialect, bytes.fromhex(text)) == (request_name, values)


def test_gains_are_single_bytes_or_one_float_by_index() -> None:
    """V3.9: six bytes, current first. V4.2: an index and a float (0.25 is 3E800000)."""
    assert encode(RMD_V3, "write_gain", index=7, gain=0.25) == bytes.fromhex("31 07 00 00 00 00 80 3E")
    assert decode(RMD_V3, "read_gain", bytes.fromhex("30 04 00 00 00 00 80 3E")) == {"index": 4, "gain": 0.25}
    assert decode(RMD_V3, "read_gains", bytes.fromhex("30 00 55 19 55 19 55 19"))["current_kp"] == 0x55
    assert decode(RMD_V1, "read_gains", bytes.fromhex("30 00 55 19 56 19 57 19"))["position_kp"] == 0x55


def test_the_model_is_text() -> None:
    assert model_text(decode(RMD_V3, "model", bytes.fromhex("B5 58 38 53 32 56 31 30"))) == "X8S2V10"
    assert decode(RMD_V3, "version", bytes.fromhex("B2 00 00 00 2E 89 34 01"))["date"] == 20220206


@pytest.mark.parametrize("name", ["zero_encoder", "write_encoder_offset", "write_gains_rom"])
def test_flash_is_never_written_silently(name: Request) -> None:
    values = dict.fromkeys(RMD_V1.entries[name].request.names, 0.0)
    with pytest.raises(ValueError, match="which wears: pass may_wear_flash=True to mean it"):
        outgoing(RMD_V1, 1, name, values)
    assert outgoing(RMD_V1, 1, name, values, may_wear_flash=True).message.data[0] == RMD_V1.entries[name].command


REPLIES = [
    (
        RMD_V3,
        "position",
        "A4 32 64 00 F4 01 2D 00",
        {"temperature_C": 50, "current": 100, "speed_dps": 500, "angle_deg": 45},
    ),
    (
        RMD_V3,
        "status_1",
        "9A 32 00 01 E5 01 04 00",
        {"temperature_C": 50, "brake_released": 1, "voltage_V": 48.5, "flags": 4},
    ),
    (RMD_V3, "multi_turn_angle", "92 00 00 00 A0 8C 00 00", {"angle_deg": 360.0}),
    (RMD_V3, "multi_turn_angle", "92 00 00 00 FF FF FF FF", {"angle_deg": -0.01}),
    (RMD_V3, "status_3", "9D 00 64 00 9C FF 01 00", {"phase_a_A": 1.0, "phase_b_A": -1.0, "phase_c_A": 0.01}),
    (RMD_V1, "status_1", "9A 1E 00 E0 01 00 00 08", {"temperature_C": 30, "voltage_V": 48.0, "flags": 8}),
    (
        RMD_V1,
        "status_2",
        "9C F6 00 F8 9C FF FF 3F",
        {"temperature_C": -10, "current": -2048, "speed_dps": -100, "encoder": 16383},
    ),
    (RMD_V1, "status_3", "9D 00 40 00 C0 FF 20 00", {"phase_a_A": 1.0, "phase_b_A": -1.0, "phase_c_A": 0.5}),
    (RMD_V1, "multi_turn_angle", "92 A0 8C 00 00 00 00 00", {"angle_deg": 360.0}),
    (RMD_V1, "multi_turn_angle", "92 60 73 FF FF FF FF FF", {"angle_deg": -360.0}),
    (RMD_V1, "multi_turn_angle", "92 00 00 00 00 01 00 00", {"angle_deg": 2**32 / 100}),
    (RMD_V1, "single_turn_angle", "94 00 00 00 00 00 9F 8C", {"angle_deg": 359.99}),
    (RMD_V1, "read_encoder", "90 00 01 00 02 00 FF 3F", {"encoder": 1, "raw": 2, "offset": 16383}),
    (RMD_V1, "clear_errors", "9A 1E 00 E0 01 00 00 00", {"temperature_C": 30, "voltage_V": 48.0, "flags": 0}),
]


@pytest.mark.parametrize(("dialect", "request_name", "text", "values"), REPLIES)
def test_replies_are_read_as_the_vendor_prints_them(
    dialect: Dialect, request_name: Request, text: str, values: dict
) -> None:
    assert decode(dialect, request_name, bytes.fromhex(text)) == pytest.approx(values)


def test_the_two_dialects_order_the_gains_the_other_way_round() -> None:
    v1 = decode(RMD_V1, "read_gains", bytes.fromhex("30 00 01 02 03 04 05 06"))
    v3 = decode(RMD_V3, "read_gains", bytes.fromhex("30 00 01 02 03 04 05 06"))
    assert (v1["position_kp"], v1["current_ki"]) == (1, 6)
    assert (v3["current_kp"], v3["position_ki"]) == (1, 6)
    assert encode(RMD_V1, "write_gains", **v1) == bytes.fromhex("31 00 01 02 03 04 05 06")
    assert encode(RMD_V3, "write_gains_rom", **v3) == bytes.fromhex("32 00 01 02 03 04 05 06")


def test_error_bits_are_told_in_words() -> None:
    assert fault_words(RMD_V1, 0x09) == ("undervoltage", "over-temperature")
    assert fault_words(RMD_V1, 0xF6) == ()
    assert fault_words(RMD_V3, 0x1002) == ("motor stalled", "motor over-temperature")


def test_v1_has_no_watchdog_and_says_what_it_has() -> None:
    with pytest.raises(ValueError, match="rmd-v1 has no request 'watchdog'; it has status_1"):
        encode(RMD_V1, "watchdog", timeout_ms=500)


@pytest.mark.parametrize("value", [math.nan, math.inf, 65536, -1])
def test_what_does_not_fit_is_refused_not_wrapped(value: float) -> None:
    with pytest.raises(ValueError, match="does not fit"):
        encode(RMD_V1, "position", speed_dps=value, angle_deg=0.0)


@pytest.mark.parametrize("text", ["", "A4", "A4 00 00 00 00 00 00", "9C 00 00 00 00 00 00 00", "A4" + " 00" * 8])
def test_a_reply_to_something_else_is_not_read(text: str) -> None:
    with pytest.raises(ValueError, match="no reply of rmd-v1 to position"):
        decode(RMD_V1, "position", bytes.fromhex(text))


@given(
    st.sampled_from(list(DIALECTS.values())),
    st.integers(0, 65535),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(-(2**55), 2**55 - 1),
)
def test_setpoints_and_angles_survive_the_wire(dialect: Dialect, speed: int, counts: int, wide: int) -> None:
    request, values = decode_request(dialect, encode(dialect, "position", speed_dps=speed, angle_deg=counts / 100))
    assert request == "position"
    assert values == {"speed_dps": speed, "angle_deg": counts / 100}
    if dialect is RMD_V1:
        # 0x92 by the definition of int56 little-endian, independent of the table.
        data = bytes([0x92]) + wide.to_bytes(7, "little", signed=True)
        assert decode(dialect, "multi_turn_angle", data)["angle_deg"] == wide / 100


@given(st.sampled_from(list(DIALECTS.values())), st.data())
def test_every_request_and_reply_of_the_table_survives_the_wire(dialect: Dialect, data: st.DataObject) -> None:
    """Any 8 bytes with a known command decode; encoding the result again changes no byte that a field covers."""
    name = data.draw(st.sampled_from(list(dialect.entries)))
    entry = dialect.entries[name]
    frame = bytes([entry.command]) + data.draw(st.binary(min_size=7, max_size=7))
    reply = decode(dialect, name, frame)
    # Above 2**53 a float no longer holds every count of an int56.
    assert decode(dialect, name, encode_reply(dialect, name, **reply)) == pytest.approx(reply, rel=1e-14)
    request, values = decode_request(dialect, frame)
    assert decode_request(dialect, encode(dialect, request, **values)) == (request, values)
