"""A real ArduPlane between a ground station and the rig: arming, throttles, routing, its death and its return."""

import os
import shutil
import subprocess
import sys
import tempfile

from peers import *

STANDBY, RUNNING = 3, 7
INSTANCE = int(os.environ["INSTANCE"])
SERIAL0, SERIAL1 = 5760 + 10 * INSTANCE, 5762 + 10 * INSTANCE
AUTOPILOT = 1

# The throttle's end points are ArduPilot's defaults, 1100 and 1900. Two throttles, on outputs 3 and 5.
SETTINGS = """\
EFI_TYPE 9
RPM1_TYPE 3
SERIAL1_PROTOCOL 2
ARMING_CHECK 0
SERVO3_FUNCTION 73
SERVO5_FUNCTION 74
RC3_MIN 1000
RC3_MAX 2000
RC3_TRIM 1000
"""


class Vehicle:
    """The simulated autopilot, and the ground station on its first serial port."""

    OPTIONS = ()

    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="jetlink-arduplane-")
        with open(os.path.join(self.folder, "plane.parm"), "w") as file:
            file.write(SETTINGS)
        self.program = None

    def start(self):
        command = [os.environ["JETLINK_ARDUPLANE"], "--model", "plane", "--speedup", str(SPEED), f"-I{INSTANCE}"]
        command += ["--defaults", "plane.parm", "--home", "-35.36,149.16,584,353", *self.OPTIONS]
        quiet = subprocess.DEVNULL
        self.program = subprocess.Popen(command, cwd=self.folder, stdout=quiet, stderr=quiet)
        self.ground = Ground(SERIAL0)
        self.throttle, self.radio = 1000, True
        self.ground.repeat(0.1, self._sticks)
        until("its heartbeat", 60, lambda: self.ground.last("HEARTBEAT", AUTOPILOT))
        self.interval(36, 10)
        self.interval(225, 10)
        self.interval(226, 5)

    def interval(self, message, hertz):
        self.ground.say(
            mav.MAVLink_command_long_message(VEHICLE, AUTOPILOT, INTERVAL, 0, message, 1e6 / hertz, 0, 0, 0, 0, 0)
        )

    def _sticks(self):
        if not self.radio:
            return
        self.ground.say(mav.MAVLink_rc_channels_override_message(VEHICLE, AUTOPILOT, *self.sticks()))

    def sticks(self):
        return [1500, 1500, self.throttle, 1500, 0, 0, 0, 0]

    def arm(self, armed):
        answer, text = self.ground.command(AUTOPILOT, 400, int(armed), 21196)
        assert answer == ACCEPTED, (answer, text)
        until("its arming", 5, lambda: (self.ground.last("HEARTBEAT", AUTOPILOT).base_mode & 128 != 0) == armed)

    def kill(self):
        if self.program:
            self.program.kill()
            self.program.wait()
            self.program = None

    def end(self):
        self.kill()
        shutil.rmtree(self.folder, ignore_errors=True)


def percent(pulse):
    return min(max((pulse - 1100) / 8, 0), 100)


def follows(ground, watch, engine, output):
    """Whether the engine's order is what the autopilot's output says."""
    efi, servo = watch.last("EFI_STATUS", engine), ground.last("SERVO_OUTPUT_RAW", AUTOPILOT)
    return efi and servo and abs(efi.throttle_out - percent(getattr(servo, output))) < 0.5


def fly(vehicle, watch):
    ground = vehicle.ground
    until("all components", 30, lambda: all(ground.last("HEARTBEAT", c) for c in (NODE, LEFT, RIGHT)))
    until("standby", 60, lambda: watch.state(LEFT) == watch.state(RIGHT) == STANDBY)
    print("every component's heartbeat came through ArduPlane")

    # Parameters are routed to each component.
    assert ground.set(RIGHT, "MAV_THR_OUT", 5) == 5
    assert ground.set(NODE, "MAV_EFI_ENGINE", 1) == 1
    for component, name in ((NODE, "MAV_SYSID"), (LEFT, "MAV_THR_OUT"), (RIGHT, "MAV_THR_OUT")):
        mark = len(ground.received)
        ground.say(mav.MAVLink_param_request_list_message(VEHICLE, component))

        def listed():
            values = ground.since(mark, "PARAM_VALUE", component)
            return values and len({value.param_index for value in values}) == values[0].param_count and values

        names = {value.param_id for value in until("its parameters", 20, listed)}
        assert name in names
        print(f"component {component}: {len(names)} parameters came through ArduPlane")

    answer, text = ground.command(LEFT, START, 1)
    assert answer == NOT_NOW and "arm the vehicle" in text, (answer, text)
    vehicle.arm(True)
    wait(10)
    assert watch.state(LEFT) == watch.state(RIGHT) == STANDBY, "arming starts nothing"
    for engine in (LEFT, RIGHT):
        answer, text = ground.command(engine, START, 1)
        assert answer == ACCEPTED, (answer, text)
        until("running", 120, lambda: ground.state(engine) == RUNNING)
        wait(12)
    print("armed: nothing started; both engines were started by command")

    servo = ground.last("SERVO_OUTPUT_RAW", AUTOPILOT)
    assert servo.servo3_raw == servo.servo5_raw == 1100, servo
    for throttle in (1500, 1800, 1250):
        vehicle.throttle = throttle
        wait(8)
        until("left follows", 10, lambda: follows(ground, watch, LEFT, "servo3_raw"))
        until("right follows", 10, lambda: follows(ground, watch, RIGHT, "servo5_raw"))
        servo, order = ground.last("SERVO_OUTPUT_RAW", AUTOPILOT), ground.last("EFI_STATUS", LEFT).throttle_out
        print(f"stick {throttle}: outputs {servo.servo3_raw} and {servo.servo5_raw}, order {order:.1f} %")
        assert servo.servo3_raw > 1150
    wait(15)
    own, rpm, efi = (ground.last(*of) for of in (("EFI_STATUS", AUTOPILOT), ("RPM", AUTOPILOT), ("EFI_STATUS", LEFT)))
    print(f"left {efi.rpm:.0f} rpm; of ArduPlane's own: EFI_STATUS {own.rpm:.0f}, RPM {rpm.rpm1:.0f}")
    assert abs(own.rpm - efi.rpm) <= 1000 and abs(rpm.rpm1 - efi.rpm) <= 1000

    # Another vehicle on the link.
    before = watch.last("EFI_STATUS", LEFT).throttle_out
    with ground.lock:
        ground.mav.srcSystem, ground.mav.srcComponent = 7, 1
        for i in range(20):
            ground.mav.send(mav.MAVLink_heartbeat_message(1, 3, 129, 0, 4, 3))
            ground.mav.send(mav.MAVLink_servo_output_raw_message(4_000_000_000 + i * 25_000, 0, *[1900] * 8))
        ground.mav.srcSystem, ground.mav.srcComponent = 255, 190
    wait(2)
    assert abs(watch.last("EFI_STATUS", LEFT).throttle_out - before) < 3, "another vehicle moves nothing"

    # Disarmed: idle, not stopped.
    vehicle.arm(False)
    until("idle", 10, lambda: watch.last("EFI_STATUS", LEFT).throttle_out == 0)
    wait(5)
    assert watch.state(LEFT) == watch.state(RIGHT) == RUNNING
    vehicle.throttle = 1000
    wait(2)
    vehicle.arm(True)
    wait(5)
    vehicle.throttle = 1600
    until("left follows again", 15, lambda: watch.last("EFI_STATUS", LEFT).throttle_out > 30)
    print("disarmed: idle; armed again: it follows")

    # A ground station's stop against the stream, through ArduPlane.
    assert ground.command(RIGHT, START, 0)[0] == ACCEPTED
    wait(2)
    assert watch.last("EFI_STATUS", RIGHT).throttle_out == 0
    assert watch.state(LEFT) == RUNNING


def death_and_return(vehicle, watch):
    before = watch.last("EFI_STATUS", LEFT).throttle_out
    assert before > 30
    vehicle.kill()
    wait(1.6)
    loss = watch.last("HEARTBEAT", LEFT).custom_mode >> 16 & 3
    print(f"1.6 s after its death: stage of loss {loss}, {watch.last('EFI_STATUS', LEFT).throttle_out:.1f} %")
    until("fail-safe throttle", 10, lambda: watch.last("EFI_STATUS", LEFT).throttle_out == 0)
    until("its stage", 3, lambda: watch.last("HEARTBEAT", LEFT).custom_mode >> 16 & 3 == 2)
    assert watch.state(LEFT) == RUNNING
    until("right is at rest", 300, lambda: watch.state(RIGHT) == STANDBY)
    vehicle.start()
    ground = vehicle.ground
    until("the components", 30, lambda: ground.last("HEARTBEAT", LEFT))
    highest = 0
    for _ in range(100):
        wait(0.1)
        highest = max(highest, watch.last("EFI_STATUS", LEFT).throttle_out)
    assert highest == 0, "it came back disarmed"
    assert (watch.state(LEFT), watch.state(RIGHT)) == (RUNNING, STANDBY)
    vehicle.arm(True)
    vehicle.throttle = 1500
    until("left follows", 20, lambda: watch.last("EFI_STATUS", LEFT).throttle_out > 20)
    assert watch.state(RIGHT) == STANDBY, "what was stopped stays stopped"
    print("killed in flight: idle; come back: no jump, no start; armed: it follows")

    # What its own fail-safe commands is obeyed.
    vehicle.radio = False
    ground.say(mav.MAVLink_param_set_message(VEHICLE, AUTOPILOT, b"SIM_RC_FAIL", 1, 9))
    wait(20)
    servo = ground.last("SERVO_OUTPUT_RAW", AUTOPILOT).servo3_raw
    mode = ground.last("HEARTBEAT", AUTOPILOT).custom_mode
    until("left follows", 10, lambda: follows(ground, watch, LEFT, "servo3_raw"))
    print(f"without RC: mode {mode}, output {servo}, order {ground.last('EFI_STATUS', LEFT).throttle_out:.1f} %")


def main():
    vehicle = Vehicle()
    try:
        vehicle.start()
        # What it has not received anything from yet, ArduPlane answers itself. This one it does not know.
        mark = len(vehicle.ground.received)
        vehicle.ground.say(mav.MAVLink_command_long_message(VEHICLE, LEFT, USER, 0, 1, 21196, 0, 0, 0, 0, 0))
        wait(1)
        acks = [ack for ack in vehicle.ground.since(mark, "COMMAND_ACK") if ack.command == USER]
        assert [(ack.get_srcComponent(), ack.result) for ack in acks] == [(AUTOPILOT, UNSUPPORTED)], acks
        print(f"listening {SERIAL1}", flush=True)
        watch = Ground(int(sys.stdin.readline()))
        fly(vehicle, watch)
        death_and_return(vehicle, watch)
        print("flown with a real ArduPlane")
    finally:
        vehicle.end()


if __name__ == "__main__":
    main()
