"""The panels say what the robot said, with units, and never run what it said."""

import math
import re

import numpy as np
import pytest

from app.console.panels import ViewTiming, motors_html, status_html, tendons_html, timing_html
from app.console.plots import POINTS, SAMPLE_S, History
from cobra.messages import Timing
from tests.app.console.scene_fakes import COBRA, drives_of, state_of, without_tendons

HOSTILE = "<img src=x onerror=\"alert('1')\">&"


def words(html):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", html)).strip()


def loads_of(**tensions):
    loads = [2.0] * len(COBRA.drives)
    for name, tension in tensions.items():
        loads[COBRA.tendon_drives[COBRA.tendon_names.index(name)]] = tension
    return drives_of(COBRA, load=tuple(loads))


def test_text_from_the_robot_is_never_markup():
    faults = (HOSTILE, *[""] * 13)
    state = state_of(cause=HOSTILE, drives=drives_of(COBRA, fault=faults), drops={HOSTILE: 3}, bus={HOSTILE: 4})
    timing = ViewTiming(age_s=0.01, errors={HOSTILE: 1})
    shown = {
        "status": status_html(state, 0.01),
        "motors": motors_html(COBRA, state),
        "timing": timing_html(state, timing, 100.0),
    }
    for name, html in shown.items():
        assert "<img" not in html, name
        assert "&lt;img src=x onerror=&quot;alert(&#x27;1&#x27;)&quot;&gt;&amp;" in html, name
    assert shown["timing"].count("&lt;img") == 3


def test_every_tendon_has_a_bar_as_long_as_its_share_of_the_limit():
    limit = COBRA.tendon.max_tension_N
    html = tendons_html(COBRA, state_of(drives=loads_of(E2=0.25 * limit, N3=3.0 * limit, S1=-1.0)))
    rows = dict(re.findall(r"class=name>(\w+)</span>.*?width:([\d.]+)%", html))
    assert tuple(rows) == COBRA.tendon_names
    assert rows["E2"] == "25.0"
    assert rows["N3"] == "100.0"
    assert rows["S1"] == "0.0"


def test_a_tendon_over_its_limit_or_slack_stands_out():
    limit = COBRA.tendon.max_tension_N
    html = tendons_html(COBRA, state_of(drives=loads_of(E2=1.5 * limit, W3=0.1)))
    alarms = dict(re.findall(r"class=name>(\w+)</span>.*?class=\"value([ \w]*)\">", html))
    assert alarms["E2"] == " bad"
    assert alarms["W3"] == " warn"
    assert alarms["S2"] == ""


def test_numbers_have_units_and_unknown_ones_are_dashes():
    count = len(COBRA.drives)
    unknown = drives_of(
        COBRA,
        load=(math.nan,) * count,
        temperature=(math.nan,) * count,
        voltage=(math.nan,) * count,
        age=(math.inf,) * count,
        valid=(False,) * count,
    )
    said = words(motors_html(COBRA, state_of(drives=unknown)))
    assert "S1 – N – °C – V –" in said
    assert "twist – N·m" in said
    assert "nan" not in said + words(tendons_html(COBRA, state_of(drives=unknown)))
    assert "S1 5.0 N 31 °C 24.1 V 4 ms" in words(motors_html(COBRA, state_of(drives=drives_of(COBRA))))


def test_every_motor_has_a_row_and_its_fault_in_words():
    faults = ["" for _ in COBRA.drives]
    faults[12] = "overheated: let it cool and clear the fault"
    said = words(motors_html(COBRA, state_of(drives=drives_of(COBRA, fault=tuple(faults)))))
    places = [said.index(f" {drive.name} ") for drive in COBRA.drives]
    assert places == sorted(places)
    assert said.index(" twist ") < said.index("overheated: let it cool") < said.index(" feed ")


def test_a_hot_motor_and_an_odd_voltage_stand_out():
    count = len(COBRA.drives)
    motor = COBRA.motor_of(COBRA.drives[0])
    state = state_of(
        drives=drives_of(
            COBRA,
            temperature=(motor.max_temperature_C - 1.0, *(30.0,) * (count - 1)),
            voltage=(24.0, motor.max_voltage_V + 1.0, *(24.0,) * (count - 2)),
        )
    )
    assert len(re.findall("class=warn", motors_html(COBRA, state))) == 2


def test_timing_is_said_in_words_and_milliseconds():
    state = state_of(
        timing=Timing(rate_Hz=99.94, period_p50=0.01, period_p99=0.0123, period_max=0.02, late=7, realtime=True),
        drops={"old epoch": 2, "bad lease": 1},
    )
    said = words(timing_html(state, ViewTiming(age_s=0.012, frame_rate_Hz=30.0, viewers=2), 100.0))
    for part in (
        "99.9 of 100 Hz",
        "period, 99 % under 12.30 ms",
        "late ticks 7",
        "newest state 12 ms old",
        "commands: bad lease 1, old epoch 2",
        "no frames not usable",
        "30.0 frames/s",
        "viewers 2",
    ):
        assert part in said


def test_before_the_first_state_the_panels_wait():
    assert "waiting" in status_html(None, math.inf)
    assert "control loop" not in timing_html(None, ViewTiming(), 100.0)


@pytest.mark.parametrize("age_s", [0.01, 0.6])
def test_old_data_are_marked_as_old(age_s):
    html = status_html(state_of(), age_s)
    assert ("class=warn" in html) == (age_s > 0.5)
    assert words(html) == f"driving data {1e3 * age_s:.0f} ms old"


def test_the_plot_keeps_the_last_twenty_seconds_of_each_channel():
    history = History(COBRA)
    tensions, bends, errors = history.channels
    for i in range(POINTS + 50):
        q = np.zeros(8)
        q[4] = 0.001 * i
        drives = drives_of(COBRA, load=(float(i),) * 14, travel=(0.0,) * 14, setpoint=(0.001 * i,) * 14)
        history.add(state_of(measured=tuple(q.tolist()), drives=drives))
    time, *loads = history.data(tensions)
    assert len(loads) == 12
    assert time[0] == pytest.approx(-(POINTS - 1) * SAMPLE_S)
    np.testing.assert_allclose(loads[3], np.arange(50, POINTS + 50))
    np.testing.assert_allclose(history.data(bends)[1 + bends.names.index("middle x")][-1], math.degrees(0.249))
    np.testing.assert_allclose(history.data(errors)[1 + errors.names.index("feed")][-1], 249.0)


def test_a_plot_begins_with_what_there_is_and_what_is_unknown_keeps_its_last_value():
    history = History(COBRA)
    tension = history.channels[0]
    history.add(state_of(drives=loads_of(S1=7.0)))
    history.add(state_of(drives=loads_of(S1=math.nan)))
    history.add(state_of(drives=loads_of(S1=9.0)))
    time, first, *_ = history.data(tension)
    np.testing.assert_allclose(first, [7.0, 7.0, 9.0])
    np.testing.assert_allclose(time, [-0.2, -0.1, 0.0])


def test_a_robot_without_tendons_has_no_tension_to_plot():
    titles = [channel.title for channel in History(without_tendons()).channels]
    assert titles == ["measured bend [°]", "setpoint less travel [mm]"]
