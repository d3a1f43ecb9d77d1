"""Commands have numbers that the controller reads back: what counts as a lost link."""

import math
import os
import socket
import threading

import numpy as np
import pytest
from palpate_arms.setpoint_buffer import PERIOD
from palpate_devices.ur.command_echo import Echo, ReadBack
from palpate_simulation.twins.direct_client import SERVO_RANGES
from palpate_simulation.twins.rtde import ClientSession, packets

PLACE = np.zeros(3)
HOST = f"127.7.{os.getpid() % 250}.1"


def driven(periods, delay, heard=lambda i: True, sent=lambda i: True):
    """The silence [s] in each period, of commands that come back after so many periods, where they are heard."""
    echo, register, silences = Echo(), [], []  # what the register is after each period
    for i in range(periods):
        now = i * PERIOD
        if i >= delay and heard(i):
            echo.hear(now, register[i - delay])
        silences.append(echo.silence(now))
        register.append(echo.number(now, PLACE) if sent(i) else register[-1])
    return silences


@pytest.mark.slow
@pytest.mark.parametrize(("delay", "longest"), [(1, 0), (2, 1), (10, 9)])
def test_a_delay_is_no_silence(delay, longest):
    """Nor are more commands than there are numbers; at the beginning it is one."""
    silences = driven(66_000, delay)
    assert max(silences[delay:]) <= longest * PERIOD + 1e-9
    assert max(silences[2 * delay :]) <= PERIOD + 1e-9


def test_every_number_is_an_acceleration_that_the_client_takes():
    echo, (least, most) = Echo(), SERVO_RANGES[1]
    numbers = [echo.number(i * PERIOD, PLACE) for i in range(70_000)]
    assert least <= min(numbers) <= max(numbers) <= most
    assert len(set(numbers)) > 10_000


@pytest.mark.slow
@pytest.mark.talks
def test_the_client_takes_what_the_direct_one_takes(restored):
    """A number that only the real client refuses had stopped every motion of more than 80 s."""
    rtde_control = pytest.importorskip("rtde_control", reason="ur-rtde is not installed")
    from rtde_receive import RTDEReceiveInterface

    receive = RTDEReceiveInterface(restored.host)
    control, pose = rtde_control.RTDEControlInterface(restored.host, 500.0), receive.getActualTCPPose()
    usual = [0.5, 0.0, 0.002, 0.1, 300.0]
    try:
        for i, (least, most) in enumerate(SERVO_RANGES):
            for value in filter(math.isfinite, (least, most)):
                assert control.servoL(pose, *usual[:i], value, *usual[i + 1 :])
            for value in filter(math.isfinite, (least * 0.999 - 1e-3, most * 1.001)):
                with pytest.raises(ValueError, match="not within"):
                    control.servoL(pose, *usual[:i], value, *usual[i + 1 :])
    finally:
        control.servoStop()
        control.stopScript()
        control.disconnect()
        receive.disconnect()


@pytest.mark.parametrize("delay", [1, 5, 40])
def test_the_time_of_an_answer_is_known_from_16_of_them_on(delay):
    """One command of many that comes back late, as of a computer that was held up, changes nothing."""
    echo, numbers, times = Echo(), [], []
    for i in range(delay + 40):
        if i >= delay and i != delay + 20:
            echo.hear(i * PERIOD, numbers[i - delay])
        numbers.append(echo.number(i * PERIOD, PLACE))
        times.append(echo.answer_time)
    assert times[: delay + 15] == [0.0] * (delay + 15)
    assert times[delay + 15 :] == pytest.approx([delay * PERIOD] * 25)


def test_commands_that_do_not_arrive_are_a_silence():
    silences = driven(200, 2, heard=lambda i: i < 100)
    assert silences[199] == pytest.approx(100 * PERIOD)


def test_a_host_that_sends_nothing_waits_for_nothing():
    silences = driven(300, 1, sent=lambda i: not 100 <= i < 200)
    assert max(silences) <= PERIOD + 1e-9


@pytest.mark.parametrize("delay", [1, 2, 5])
def test_how_far_a_command_is_ahead_of_what_was_taken(delay):
    """A step of 1 mm in each period: those that come back late count as taken, until one is later than usual."""
    echo, numbers, ahead = Echo(), [], []
    for i in range(40):
        now = i * PERIOD
        heard = min(i, 20) if i < 30 else i  # from 20 to 29 the controller takes none
        if heard >= delay:
            echo.hear(now, numbers[heard - delay])
        ahead.append(echo.ahead(now))
        numbers.append(echo.number(now, np.array([0.0, 0.0, 1e-3 * i])))
    still = [1e-3 * (i - 1 - (20 - delay)) for i in range(21, 30)]
    assert ahead == pytest.approx([0.0] * 21 + still + [0.0] * 10)


def test_without_a_new_state_the_latest_command_is_ahead():
    echo = Echo()
    for i in range(3):
        echo.number(0.002 * i, np.array([0.0, 0.0, 1e-3 * i]))
    assert echo.ahead(0.004) == pytest.approx(1e-3)  # the controller has not yet shown that tick
    assert echo.ahead(0.006) == 0.0
    assert Echo().ahead(0.0) == 0.0


def served(unknown=""):
    """A controller that reads registers back for one connection, once it has been asked to."""
    server = socket.create_server((HOST, 30004))

    def serve():
        link, _ = server.accept()
        session, buffer = ClientSession((5, 12, 4, 0), lambda s, n: True, lambda v: None, unknown), bytearray()
        with link:
            while data := link.recv(4096):
                buffer += data
                for kind, payload in packets(buffer):
                    link.sendall(session.answer(kind, payload))
                if session.started:
                    for i in range(3):
                        link.sendall(session.data({"timestamp": float(i), "input_double_register_7": 0.5 * i}))
                    return

    thread = threading.Thread(target=serve)
    thread.start()
    return server, thread


def test_the_newest_state_is_read():
    server, thread = served()
    with server:
        link = ReadBack(HOST)
        thread.join()
        assert link.latest() == (2.0, 1.0)
        assert link.latest() is None
        link.close()


def test_a_controller_without_the_register_is_refused():
    server, thread = served("input_double_register_7")
    with server, pytest.raises(RuntimeError, match="does not read input_double_register_7 back"):
        ReadBack(HOST)
    thread.join()


def test_a_controller_that_is_not_there_is_refused():
    with pytest.raises(RuntimeError, match=r"does not read commands back: .*refused"):
        ReadBack(HOST)
