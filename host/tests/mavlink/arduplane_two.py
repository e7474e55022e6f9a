"""A real ArduPlane with another vehicle on its link from the very start: armed, and at full throttle. ArduPlane forwards its frames to the
rig."""

import socket
import sys

from arduplane import RUNNING, SERIAL1, STANDBY, Vehicle, follows
from peers import *

OTHER = 7


class Other:
    """The other vehicle. Its frames arrive on the ground station's link, as those of a second vehicle on one radio do."""

    def __init__(self, ground):
        self.ground = ground
        self.mav = mav.MAVLink(ground, srcSystem=OTHER, srcComponent=1)
        self.present, self.armed = True, True
        self.started = time.monotonic()
        ground.repeat(1, self._beat)
        ground.repeat(0.1, self._outputs)

    def _say(self, message):
        if self.present:
            with self.ground.lock:
                self.mav.send(message)

    def _beat(self):
        self._say(mav.MAVLink_heartbeat_message(1, 3, 129 if self.armed else 1, 0, 4, 3))

    def _outputs(self):
        usec = int((time.monotonic() - self.started) * SPEED * 1e6) & 0xFFFFFFFF
        self._say(mav.MAVLink_servo_output_raw_message(usec, 0, *[1900] * 8))


def forwards():
    """ArduPlane forwards other vehicles' frames to a port once it has received a heartbeat there. A node sends none before it has an id, so a
    new one on a new port learns its own autopilot. A node that replaces another one finds
    a port that was in use."""
    port = Peer(socket.create_connection(("127.0.0.1", SERIAL1)), 51, 68)
    systems = lambda: {m.get_srcSystem() for m in port.received if m.get_type() != "BAD_DATA"}
    wait(10)
    assert systems() == {VEHICLE}, systems()
    port.say(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    until("the other vehicle", 10, lambda: OTHER in systems())
    port.connection.shutdown(socket.SHUT_RDWR)
    port.connection.close()
    return "a port that is new gets ArduPlane's own frames alone, one that was in use those of the other vehicle as well"


def from_the_start(vehicle, watch):
    """Neither is learnt, and nothing is sent but a text, on both ports."""
    ground = vehicle.ground

    def warned(peer):
        texts = [text for text in peer.received if text.get_type() == "STATUSTEXT" and text.get_srcComponent() == NODE]
        return {text.get_srcSystem() for text in texts if "two autopilots, systems" in text.text}

    until("a text under each id, through ArduPlane", 20, lambda: warned(ground) == {VEHICLE, OTHER})
    vehicle.arm(True)
    mark, of_watch = len(ground.received), len(watch.received)
    for component in (LEFT, RIGHT):
        for system in (VEHICLE, OTHER):
            watch.command(component, START, 1, 0, 0, 1, system=system, answered=False)
    wait(20)
    ours = [message for message in ground.received[mark:] if message.get_srcComponent() in (NODE, LEFT, RIGHT)]
    assert ours == watch.received[of_watch:] == [], (ours, watch.received[of_watch:])
    vehicle.arm(False)
    print("both from the start: a text under each id, and 20 s without an answer, a heartbeat or a start")


def learnt(vehicle, watch, other):
    """Our own one is, once it is alone; then the other one returns."""
    ground = vehicle.ground
    other.present = False
    until("all components", 30, lambda: all(ground.last("HEARTBEAT", c) for c in (NODE, LEFT, RIGHT)))
    assert {ground.last("HEARTBEAT", c).get_srcSystem() for c in (NODE, LEFT, RIGHT)} == {VEHICLE}
    other.present = True
    until("standby", 60, lambda: watch.state(LEFT) == watch.state(RIGHT) == STANDBY)
    assert ground.set(RIGHT, "MAV_THR_OUT", 5) == 5
    # Its arming is not ours.
    answer, text = ground.command(LEFT, START, 1)
    assert answer == NOT_NOW and "arm the vehicle" in text, (answer, text)
    vehicle.arm(True)
    wait(6)
    for engine in (LEFT, RIGHT):
        answer, text = ground.command(engine, START, 1)
        assert answer == ACCEPTED, (answer, text)
        until("running", 120, lambda: ground.state(engine) == RUNNING)
        wait(12)
    other.armed = False
    highest = 0
    for _ in range(50):
        wait(0.1)
        highest = max(highest, *(watch.last("EFI_STATUS", engine).throttle_out for engine in (LEFT, RIGHT)))
    assert highest == 0, highest
    vehicle.throttle = 1500
    wait(8)
    until("left follows", 10, lambda: follows(ground, watch, LEFT, "servo3_raw"))
    until("right follows", 10, lambda: follows(ground, watch, RIGHT, "servo5_raw"))
    order = watch.last("EFI_STATUS", LEFT).throttle_out
    assert 20 < order < 80, order
    print(f"learnt once it was alone; beside the other one at full throttle: idle at idle, then {order:.1f} %")
    # Our own one disarms: idle, although the other one is armed.
    other.armed = True
    wait(3)
    vehicle.arm(False)
    until("idle", 10, lambda: all(watch.last("EFI_STATUS", e).throttle_out == 0 for e in (LEFT, RIGHT)))
    wait(5)
    assert watch.last("EFI_STATUS", LEFT).throttle_out == 0 and watch.state(LEFT) == watch.state(RIGHT) == RUNNING


def main():
    vehicle = Vehicle()
    try:
        vehicle.start()
        other = Other(vehicle.ground)
        found = forwards()
        print(f"listening {SERIAL1}", flush=True)
        watch = Ground(int(sys.stdin.readline()))
        print(found)
        from_the_start(vehicle, watch)
        learnt(vehicle, watch, other)
        print("flown beside another vehicle")
    finally:
        vehicle.end()


if __name__ == "__main__":
    main()
