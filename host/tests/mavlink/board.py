"""A pilot written from the MAVLink documents, against the release image on an emulated board: a ground station and an autopilot at
the telemetry UART, which carries both. In real time; the engine flown is the first, an AMT ECU."""

import sys

from peers import *
from pilot import RUNNING, STANDBY, cancelled, emergency, parameters, record, refusals

CENTRE, BOOSTER = 28, 29
COMPONENTS = (NODE, LEFT, RIGHT, CENTRE, BOOSTER)


class Line(Ground):
    """The far end of the UART: the ground station's frames, and those of the autopilot that relays them."""

    def __init__(self, port):
        self.autopilot = mav.MAVLink(self, srcSystem=VEHICLE, srcComponent=1)
        self.armed, self.pulse = False, 1100
        self.requests = []
        self.started = time.monotonic()
        super().__init__(port)
        self.repeat(1, self._beat)
        self.repeat(0.04, self._outputs)

    def sign(self, key, stamp):
        super().sign(key, stamp)
        with self.lock:
            self.autopilot.signing.secret_key = key
            self.autopilot.signing.sign_outgoing = key is not None
            self.autopilot.signing.timestamp = stamp

    def _send(self, message):
        with self.lock:
            self.autopilot.send(message)

    def _beat(self):
        self._send(mav.MAVLink_heartbeat_message(1, 3, 129 if self.armed else 1, 0, 4, 3))

    def _outputs(self):
        if self.requests:
            usec = int((time.monotonic() - self.started) * 1e6) & 0xFFFFFFFF
            self._send(mav.MAVLink_servo_output_raw_message(usec, 0, 0, 0, self.pulse, 0, 0, 0, 0, 0))

    def on(self, message):
        if message.get_type() == "COMMAND_LONG" and message.command == INTERVAL:
            self.requests.append(message.param2)
            back = message.get_srcSystem(), message.get_srcComponent()
            self._send(mav.MAVLink_command_ack_message(INTERVAL, 0, 0, 0, *back))


def discovery(line):
    for component in COMPONENTS:
        beat = until("a heartbeat", 20, lambda: line.last("HEARTBEAT", component))
        assert beat.get_srcSystem() == VEHICLE
        assert (beat.type, beat.autopilot, beat.base_mode, beat.mavlink_version) == (0, 8, 1, 3), beat
    until("standby", 30, lambda: all(line.state(component) == STANDBY for component in COMPONENTS[1:]))
    until("the outputs are requested", 10, lambda: line.requests)
    efi = {message.get_srcComponent() for message in line.since(0, "EFI_STATUS")}
    assert efi == {LEFT}, f"the autopilot's port carries one engine: {efi}"


def restart(line):
    """Parameters are retained over a restart of the node by command. Returns where in `received` it came."""
    mark = len(line.received)
    assert line.command(NODE, REBOOT, 1)[0] == ACCEPTED
    until("a heartbeat", 30, lambda: len(line.since(mark, "HEARTBEAT", LEFT)) > 2)
    assert line.read(LEFT, "LOSS_THR") == 100
    until("standby", 30, lambda: line.state(LEFT) == STANDBY)
    return mark


def flight(line):
    answer, text = line.command(LEFT, START, 1)
    assert answer == ACCEPTED and "refused" not in text, (answer, text)
    assert line.command(LEFT, START, 1)[0] == ACCEPTED, "a repeat within 5 s"
    until("running", 90, lambda: line.state(LEFT) == RUNNING)
    wait(3)
    idle = line.last("EFI_STATUS", LEFT)
    line.pulse = 1500
    until("half throttle", 15, lambda: line.last("EFI_STATUS", LEFT).throttle_out == 50)
    wait(8)
    half = line.last("EFI_STATUS", LEFT)
    assert half.rpm > idle.rpm + 10_000 and half.health == 1 and half.ecu_index == 0, (idle, half)
    assert half.exhaust_gas_temperature == half.cylinder_head_temperature > 300, half
    print(f"idle {idle.rpm:.0f} rpm, half throttle {half.rpm:.0f} rpm, {half.exhaust_gas_temperature:.1f} C")
    assert line.set(LEFT, "MAV_THR_OUT", 7) == 3, "refused while it turns"
    assert line.command(NODE, REBOOT, 1)[0] == NOT_NOW
    assert [line.state(component) for component in (RIGHT, CENTRE, BOOSTER)] == [STANDBY] * 3
    # A ground station's stop acts against the stream.
    assert line.command(LEFT, START, 0)[0] == ACCEPTED
    until("no throttle", 2, lambda: line.last("EFI_STATUS", LEFT).throttle_out == 0)
    answer, text = line.command(LEFT, START, 1, confirmation=1)
    assert answer == NOT_NOW and "repeat" in text, (answer, text)
    line.pulse = 1100


def main():
    line = Line(int(sys.argv[1]))
    discovery(line)
    parameters(line, LEFT, COMPONENTS, 60)
    restarted = restart(line)
    refusals(line, line, LEFT)
    mark = len(line.received)
    flight(line)
    wait(5)
    record(line, mark)
    cancelled(line, CENTRE)
    emergency(line, BOOSTER, RIGHT)
    # A node that restarts cuts the frame that it was sending.
    cuts = line.cuts()
    assert len(cuts) <= 1 and all(at >= restarted for at in cuts), (restarted, [(at, line.received[at]) for at in cuts])
    print("all as the documents have it")


if __name__ == "__main__":
    main()
