"""A real ArduPlane as the transmitter: its SBUS output on SERIAL2 is radio control, its MAVLink on SERIAL1 the lower source."""

import socket
import sys

import arduplane
from arduplane import AUTOPILOT, INSTANCE, RUNNING, STANDBY, Vehicle
from peers import *

SERIAL2 = 5763 + 10 * INSTANCE
STOP, MIDDLE, RUN = 1000, 1500, 2000
STOP_LATCHED = 1 << 10

# Throttle on output 3, with ArduPilot's end points. Outputs 5 and 7 pass the transmitter's channels on: switch and hand-over switch.
arduplane.SETTINGS = """\
EFI_TYPE 9
SERIAL1_PROTOCOL 2
SERIAL2_PROTOCOL 15
ARMING_CHECK 0
SERVO3_FUNCTION 73
SERVO5_FUNCTION 55
SERVO7_FUNCTION 57
RC3_MIN 1000
RC3_MAX 2000
RC3_TRIM 1000
"""


class Pilot(Vehicle):
    """The autopilot with a switch on channel 5 and a hand-over switch on channel 7 beside the stick."""

    OPTIONS = ("--serial2", f"tcp:{SERIAL2}:nowait")
    switch, hand = STOP, 1000

    def sticks(self):
        return [1500, 1500, self.throttle, 1500, self.switch, 0, self.hand, 0]


class Wire:
    """Between ArduPlane's SERIAL2 and the rig: a wire that can be pulled."""

    def __init__(self):
        self.plugged = True
        self.frames = 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        rig, _ = self.listener.accept()
        rig.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while True:
            try:
                self._pass(socket.create_connection(("127.0.0.1", SERIAL2)), rig)
            except OSError:
                time.sleep(0.2)

    def _pass(self, autopilot, rig):
        while chunk := autopilot.recv(4096):
            if self.plugged:
                self.frames += len(chunk) // 25
                rig.sendall(chunk)


def ordered(watch, engine):
    return watch.last("EFI_STATUS", engine).throttle_out


def latched(watch, engine):
    return bool(watch.last("HEARTBEAT", engine).custom_mode & STOP_LATCHED)


def both(watch, what):
    return all(what(watch, engine) for engine in (LEFT, RIGHT))


def states(watch):
    return watch.state(LEFT), watch.state(RIGHT)


def follows(vehicle, watch, *engines):
    """Whether the orders are what ArduPlane's output 3 says; its SBUS output is 5 or 6 µs longer."""
    servo = vehicle.ground.last("SERVO_OUTPUT_RAW", AUTOPILOT)
    return all(abs(ordered(watch, engine) - arduplane.percent(servo.servo3_raw + 5)) < 1 for engine in engines)


def commanded_by(vehicle, watch, engine):
    """The source whose throttle is ordered: by SBUS it is 0.8 % more than by MAVLink."""
    servo = vehicle.ground.last("SERVO_OUTPUT_RAW", AUTOPILOT).servo3_raw
    more = ordered(watch, engine) - arduplane.percent(servo)
    return "mavlink" if abs(more) < 0.3 else "rc" if abs(more - 0.75) < 0.3 else None


def goes_to(source, vehicle, watch):
    until(f"{source} commands left", 15, lambda: commanded_by(vehicle, watch, LEFT) == source)


def jumps(watch, mark, engine):
    """Greatest change of the order from one report to the next, in percent."""
    orders = [efi.throttle_out for efi in watch.since(mark, "EFI_STATUS", engine)]
    assert len(orders) > 20, len(orders)
    return max(abs(b - a) for a, b in zip(orders, orders[1:]))


def start_throttle_and_stop(vehicle, watch):
    until("stopped by the switch", 30, lambda: both(watch, latched))
    vehicle.switch = RUN
    wait(5)
    assert both(watch, latched), "from stop to run is no release"
    vehicle.switch = STOP
    wait(2)
    vehicle.arm(True)
    wait(3)
    vehicle.switch = MIDDLE
    until("released", 30, lambda: not latched(watch, LEFT) and not latched(watch, RIGHT))
    until("standby", 60, lambda: states(watch) == (STANDBY, STANDBY))
    wait(3)
    vehicle.throttle = 1600
    wait(2)
    vehicle.switch = RUN
    wait(5)
    assert states(watch) == (STANDBY, STANDBY), "no start with the stick up"
    vehicle.switch, vehicle.throttle = MIDDLE, 1000
    wait(3)
    vehicle.switch = RUN
    until("both run", 240, lambda: states(watch) == (RUNNING, RUNNING))
    print("SBUS: released and armed, no start with the stick up, both engines started by the switch")
    wait(12)
    for throttle in (1500, 1800, 1250):
        vehicle.throttle = throttle
        wait(8)
        until("both follow", 15, lambda: follows(vehicle, watch, LEFT, RIGHT))
        servo = vehicle.ground.last("SERVO_OUTPUT_RAW", AUTOPILOT).servo3_raw
        print(f"stick {throttle}: output {servo}, orders {ordered(watch, LEFT):.1f} and {ordered(watch, RIGHT):.1f} %")
        assert servo > 1150


def death_and_return(vehicle, watch):
    assert ordered(watch, LEFT) > 10
    vehicle.kill()
    wait(1)
    print(f"1 s after its death: stage of loss {watch.last('HEARTBEAT', LEFT).custom_mode >> 16 & 3}")
    until("idle", 10, lambda: ordered(watch, LEFT) == ordered(watch, RIGHT) == 0)
    until("its stage", 3, lambda: watch.last("HEARTBEAT", LEFT).custom_mode >> 16 & 3 == 2)
    assert states(watch) == (RUNNING, RUNNING)
    vehicle.switch = RUN
    vehicle.start()
    until("its SBUS", 60, lambda: watch.last("HEARTBEAT", LEFT).custom_mode >> 16 & 3 == 0)
    wait(5)
    orders = ordered(watch, LEFT), ordered(watch, RIGHT)
    assert max(orders) < 1, f"disarmed: {orders}"
    assert states(watch) == (RUNNING, RUNNING)
    vehicle.arm(True)
    vehicle.throttle = 1500
    until("both follow", 20, lambda: ordered(watch, LEFT) > 20 and follows(vehicle, watch, LEFT, RIGHT))
    print("killed in flight: idle; restarted: no jump, no start; armed: both follow")
    vehicle.throttle, vehicle.switch = 1000, STOP
    until("stopped", 3, lambda: both(watch, latched))
    print("the switch to stop: both latched")


def hand_over(vehicle, watch, wire):
    ground = vehicle.ground
    vehicle.switch = MIDDLE
    until("released", 120, lambda: not latched(watch, LEFT) and not latched(watch, RIGHT))
    until("standby", 300, lambda: states(watch) == (STANDBY, STANDBY))
    # MAVLink starts only what was disarmed after the stop.
    vehicle.arm(False)
    wait(5)
    vehicle.arm(True)
    wait(3)
    answer, text = ground.command(LEFT, START, 1)
    assert answer != ACCEPTED, "radio control streams standby"
    print(f"MAVLink's start behind radio control: {answer}, {text}")
    wire.plugged = False
    wait(8)
    answer, text = ground.command(LEFT, START, 1)
    assert answer == ACCEPTED, (answer, text)
    until("left runs", 120, lambda: watch.state(LEFT) == RUNNING)
    wait(12)
    vehicle.throttle = 1500
    vehicle.switch = RUN
    wait(8)
    before = ordered(watch, LEFT)
    assert before > 30 and commanded_by(vehicle, watch, LEFT) == "mavlink"

    mark = len(watch.received)
    wire.plugged = True
    goes_to("rc", vehicle, watch)
    wait(8)
    there, by_rc = jumps(watch, mark, LEFT), ordered(watch, LEFT)
    assert there <= 1 and watch.state(RIGHT) == STANDBY
    vehicle.throttle = 1600
    wait(5)
    until("left follows", 10, lambda: commanded_by(vehicle, watch, LEFT) == "rc")
    assert ordered(watch, LEFT) > 55

    mark = len(watch.received)
    wire.plugged = False
    goes_to("mavlink", vehicle, watch)
    wait(8)
    back = jumps(watch, mark, LEFT)
    assert back <= 1 and watch.state(LEFT) == RUNNING
    print(f"to radio control and back: {before:.1f}, {by_rc:.1f} %; greatest change {there:.1f} and {back:.1f} % in 0.1 s")
    vehicle.throttle = 1300
    wait(5)
    assert commanded_by(vehicle, watch, LEFT) == "mavlink" and ordered(watch, LEFT) < 40
    wire.plugged = True
    goes_to("rc", vehicle, watch)
    wait(8)


def hand_over_by_channel(vehicle, watch):
    """With both received all the time: the channel gives the engine to MAVLink and takes it back, and the switch keeps the stop."""
    mark, before = len(watch.received), ordered(watch, LEFT)
    vehicle.hand = 2000
    goes_to("mavlink", vehicle, watch)
    wait(8)
    there = jumps(watch, mark, LEFT)
    assert there <= 1 and watch.state(LEFT) == RUNNING
    # The switch is at run, and its moves to standby and back are nothing.
    vehicle.switch = MIDDLE
    wait(3)
    vehicle.switch = RUN
    vehicle.throttle = 1500
    wait(5)
    assert commanded_by(vehicle, watch, LEFT) == "mavlink" and ordered(watch, LEFT) > before + 10

    mark = len(watch.received)
    vehicle.hand = 1000
    goes_to("rc", vehicle, watch)
    wait(8)
    back = jumps(watch, mark, LEFT)
    assert back <= 1 and watch.state(LEFT) == RUNNING
    print(f"by the hand-over channel: greatest change {there:.1f} and {back:.1f} % in 0.1 s")
    vehicle.hand = 2000
    goes_to("mavlink", vehicle, watch)
    vehicle.switch = STOP
    until("stopped while it is handed over", 5, lambda: latched(watch, LEFT))


def main():
    vehicle, wire = Pilot(), Wire()
    try:
        vehicle.start()
        vehicle.switch = STOP
        print(f"listening {arduplane.SERIAL1} {wire.port}", flush=True)
        watch = Ground(int(sys.stdin.readline()))
        until("all components", 60, lambda: all(watch.last(m, c) for m in ("EFI_STATUS", "HEARTBEAT") for c in (LEFT, RIGHT)))
        start_throttle_and_stop(vehicle, watch)
        death_and_return(vehicle, watch)
        hand_over(vehicle, watch, wire)
        hand_over_by_channel(vehicle, watch)
        print(f"flown by the SBUS output of a real ArduPlane, {wire.frames} frames")
    finally:
        vehicle.end()


if __name__ == "__main__":
    main()
