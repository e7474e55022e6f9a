"""A pilot written from the MAVLink documents, against `jetlink rig --mavlink`: two engines, left (AMT) and right (ZK)."""

import os
import socket
import sys

from peers import *

STANDBY, START_REQUESTED, STARTING, RUNNING = 3, 5, 6, 7


def discovery(ground, plane):
    until("the autopilot is learnt", 20, lambda: plane.last("HEARTBEAT", NODE))
    for peer in (ground, plane):
        for component in (NODE, LEFT, RIGHT):
            beat = until("a heartbeat", 5, lambda: peer.last("HEARTBEAT", component))
            assert beat.get_srcSystem() == VEHICLE
            assert (beat.type, beat.autopilot, beat.base_mode, beat.mavlink_version) == (0, 8, 1, 3), beat
    until("standby", 60, lambda: ground.state(LEFT) == STANDBY and ground.state(RIGHT) == STANDBY)
    until("the outputs are requested", 5, lambda: plane.requests)
    assert plane.requests == [25_000], plane.requests
    efi = {message.get_srcComponent() for message in plane.since(0, "EFI_STATUS")}
    assert efi == {LEFT}, "the autopilot gets one engine"
    assert {message.get_srcComponent() for message in ground.since(0, "EFI_STATUS")} == {LEFT, RIGHT}


def parameters(ground, engine, components, within):
    """All of the node and of its engines, listed; one of an engine set, and wrong values refused."""
    mark = len(ground.received)
    ground.say(mav.MAVLink_param_request_list_message(VEHICLE, 0))

    def all_listed():
        values = ground.since(mark, "PARAM_VALUE")
        counts = {value.get_srcComponent(): value.param_count for value in values}
        return values if len(counts) == len(components) and len(values) >= sum(counts.values()) else None

    values = until("all parameters", within, all_listed)
    wait(1)
    listed = {}
    for value in values:
        assert value.param_type == 9 and value.get_srcSystem() == VEHICLE
        listed.setdefault(value.get_srcComponent(), []).append((value.param_index, value.param_id))
    assert set(listed) == set(components), set(listed)
    for component, of_component in listed.items():
        assert [index for index, _ in of_component] == list(range(len(of_component))), component
        assert len({name for _, name in of_component}) == len(of_component)
        print(f"component {component}: {len(of_component)} parameters")
    assert ground.read(engine, "LOSS_THR") == 0
    assert ground.set(engine, "LOSS_THR", 100) == 100
    # A busy computer is no lost source.
    assert ground.set(engine, "SRC_MAV_TOUT", 20_000) == 20_000
    for wrong, why in ((5000, "out of range"), (0.5, "not whole"), (float("nan"), "no number")):
        assert ground.set(engine, "LOSS_THR", wrong) == 100, why
    assert ground.read(engine, "LOSS_THR") == 100


def refusals(ground, plane, engine):
    answer, text = ground.command(engine, START, 1)
    assert answer == NOT_NOW and "arm the vehicle" in text, (answer, text)
    plane.armed = True
    wait(8)
    assert ground.state(engine) == STANDBY, "arming starts nothing"
    assert ground.command(engine, START, 1, 0, 5)[0] == DENIED, "a height delay"
    assert ground.command(engine, START, float("nan"))[0] == DENIED
    assert ground.command(engine, 400, 1)[0] == UNSUPPORTED
    assert ground.command(NODE, START, 1)[0] == UNSUPPORTED
    for system, component in ((VEHICLE, 0), (0, engine), (7, engine), (VEHICLE, 99)):
        assert ground.command(component, START, 1, system=system, answered=False)[0] is None, (system, component)
    # What is not in the dialect, and what ends in the middle.
    ground.say(mav.MAVLink_radio_status_message(1, 1, 0, 0, 0, 0, 0))
    with ground.lock:
        ground.write(b"\xfd\x20\x00\x00\x01\xff\xbe\x4c\x00\x00\x00\x00")
        ground.write(bytes(range(256)) * 2)
    wait(5)
    assert ground.state(engine) == STANDBY


def flight(ground, plane):
    answer, text = ground.command(RIGHT, START, 1)
    assert answer == ACCEPTED and "refused" not in text, (answer, text)
    assert ground.command(RIGHT, START, 1)[0] == ACCEPTED, "a repeat within 5 s"
    until("running", 120, lambda: ground.state(RIGHT) == RUNNING)
    plane.pulse = 1500
    until("half throttle", 15, lambda: ground.last("EFI_STATUS", RIGHT).throttle_out == 50)
    wait(12)
    efi = ground.last("EFI_STATUS", RIGHT)
    assert abs(efi.throttle_position - 50) <= 1 and efi.health == 1 and efi.ecu_index == 1, efi
    assert efi.exhaust_gas_temperature == efi.cylinder_head_temperature > 300, efi
    print(f"steady: {efi.rpm:.0f} rpm, {efi.exhaust_gas_temperature:.1f} C, {efi.fuel_flow:.0f} ml/min")
    named = {message.name for message in plane.since(0, "NAMED_VALUE_FLOAT", RIGHT)}
    assert {"rpm2", "egt2", "flow2", "thr2", "pumpv2", "link2"} <= named, named
    assert ground.set(RIGHT, "MAV_THR_OUT", 7) == 3, "refused while it turns"
    assert ground.command(NODE, REBOOT, 1)[0] == NOT_NOW
    # Another vehicle's outputs, on the same line.
    with plane.lock:
        plane.mav.srcSystem = 7
        plane.mav.send(mav.MAVLink_servo_output_raw_message(4_000_000_000, 0, *[1900] * 8))
        plane.mav.srcSystem = VEHICLE
    wait(0.5)
    assert ground.last("EFI_STATUS", RIGHT).throttle_out == 50
    # A ground station's stop acts against the stream.
    mark = len(ground.received)
    ground.say(mav.MAVLink_command_long_message(VEHICLE, RIGHT, START, 0, 0, 0, 0, 0, 0, 0, 0))
    ack = until("an answer", 0.5, lambda: ground.since(mark, "COMMAND_ACK", RIGHT))[0]
    assert ack.result == ACCEPTED
    until("no throttle", 1, lambda: ground.last("EFI_STATUS", RIGHT).throttle_out == 0)
    answer, text = ground.command(RIGHT, START, 1, confirmation=1)
    assert answer == NOT_NOW and "repeat" in text, (answer, text)
    plane.pulse = 1100


def flight_of_the_other(ground, plane):
    """The AMT engine, whose protocol is another."""
    # Until the stream is at idle.
    wait(5)
    answer, text = ground.command(LEFT, START, 1)
    assert answer == ACCEPTED and "refused" not in text, (answer, text)
    until("running", 120, lambda: ground.state(LEFT) == RUNNING)
    plane.pulse = 1700
    until("throttle", 15, lambda: ground.last("EFI_STATUS", LEFT).throttle_out == 75)
    wait(12)
    plane.pulse = 1100
    assert ground.command(LEFT, START, 0)[0] == ACCEPTED


def record(ground, mark):
    """All EFI_STATUS since then, for efi.py: whether they are what the ECUs have sent."""
    with open(os.environ["EFI_LOG"], "w") as log:
        for efi in ground.since(mark, "EFI_STATUS"):
            values = efi.rpm, efi.exhaust_gas_temperature, efi.fuel_flow, efi.throttle_position
            print(efi.get_srcComponent(), *values, file=log)


def cancelled(ground, engine):
    """A start is cancelled: a stop, and its repeat starts nothing."""

    def at_rest():
        # An autopilot's port has the EFI_STATUS of one engine only.
        efi = ground.last("EFI_STATUS", engine)
        return ground.state(engine) == STANDBY and not (efi and efi.rpm >= 500)

    until("at rest", 400, at_rest)
    wait(6)
    answer, text = ground.command(engine, START, 1)
    assert answer == ACCEPTED and "refused" not in text, (answer, text)
    until("starting", 30, lambda: ground.state(engine) in (START_REQUESTED, STARTING))
    mark = len(ground.received)
    ground.say(CommandCancel(VEHICLE, engine, START))
    ack = until("an answer", 0.5, lambda: ground.since(mark, "COMMAND_ACK", engine))[0]
    assert (ack.command, ack.result) == (START, CANCELLED), ack
    until("the start ends", 5, lambda: ground.state(engine) not in (START_REQUESTED, STARTING))
    answer, text = ground.command(engine, START, 1, confirmation=1)
    assert answer == NOT_NOW and "repeat" in text, (answer, text)


def restart(ground):
    """Parameters are kept over a restart of the node, and stations find it again."""
    for engine in (LEFT, RIGHT):
        at_rest = lambda: ground.state(engine) == STANDBY and ground.last("EFI_STATUS", engine).rpm < 500
        until("at rest", 400, at_rest)
    assert ground.set(RIGHT, "MAV_THR_MAX", 2000) == 2000
    mark = len(ground.received)
    assert ground.command(NODE, REBOOT, 1)[0] == ACCEPTED
    until("a heartbeat", 15, lambda: len(ground.since(mark, "HEARTBEAT", RIGHT)) > 2)
    assert ground.read(RIGHT, "LOSS_THR") == 100
    assert ground.read(RIGHT, "MAV_THR_MAX") == 2000


def emergency(ground, engine, other):
    assert ground.command(engine, USER, 1, 0)[0] == DENIED, "without its number"
    assert ground.command(engine, USER, 1, 21196)[0] == ACCEPTED
    until("it is shown", 2, lambda: ground.last("HEARTBEAT", engine).system_status == 8)
    assert ground.last("HEARTBEAT", other).system_status != 8
    answer, text = ground.command(engine, START, 1)
    assert answer == NOT_NOW, text
    assert ground.command(engine, USER, 2, 0)[0] == DENIED
    assert ground.command(engine, USER, 2, 21196)[0] == ACCEPTED
    until("released", 3, lambda: ground.last("HEARTBEAT", engine).system_status != 8)
    wait(5)
    answer, text = ground.command(engine, START, 1)
    assert answer == NOT_NOW and "disarm the vehicle" in text, (answer, text)


# Node restarts that this flight requests.
RESTARTS = 1
KEY = bytes(range(1, 33))
STAMP = 36_500_000_000_000


def signing(ground, plane):
    """What is not signed moves nothing, except over USB: the ground station's port, which only this computer reaches."""

    def set_up(peer, key, text):
        mark = len(peer.received)
        peer.say(mav.MAVLink_setup_signing_message(VEHICLE, NODE, list(key), STAMP))
        until(text, 2, lambda: text in "".join(said.text for said in peer.since(mark, "STATUSTEXT", NODE)))

    def threshold(value):
        return mav.MAVLink_param_set_message(VEHICLE, RIGHT, b"LOSS_THR", value, 9)

    def ignored(frame):
        mark, before = len(plane.received), ground.read(RIGHT, "LOSS_THR")
        with plane.lock:
            plane.write(frame)
        wait(5)
        assert ground.read(RIGHT, "LOSS_THR") == before
        assert not plane.since(mark, "PARAM_VALUE")

    unsigned = threshold(200).pack(plane.mav)
    plane.armed = False
    wait(5)
    set_up(plane, KEY, "over USB")
    assert Ground.set(plane, RIGHT, "LOSS_THR", 120) == 120, "without a key"
    set_up(ground, KEY, "signing key set")
    ignored(unsigned)
    assert ground.set(RIGHT, "LOSS_THR", 130) == 130, "over USB"
    for peer in (ground, plane):
        peer.sign(KEY, STAMP)
    wait(1)
    begin = {peer: len(peer.received) for peer in (ground, plane)}
    assert Ground.set(plane, RIGHT, "LOSS_THR", 140) == 140, "signed"
    with plane.lock:
        frame = threshold(150).pack(plane.mav)
        plane.write(frame)
    until("signed", 2, lambda: ground.read(RIGHT, "LOSS_THR") == 150)
    assert Ground.set(plane, RIGHT, "LOSS_THR", 160) == 160
    ignored(frame)
    stranger = mav.MAVLink(None, srcSystem=VEHICLE, srcComponent=1)
    stranger.signing.secret_key, stranger.signing.sign_outgoing = KEY[::-1], True
    stranger.signing.timestamp = STAMP * 2
    ignored(threshold(170).pack(stranger))
    wait(20)
    for peer, mark in begin.items():
        received = peer.received[mark:]
        assert len(received) > 100, len(received)
        unsigned = [message for message in received if not message.get_signed()]
        assert not unsigned, (len(unsigned), [str(message) for message in unsigned[:3]])
    until("at rest", 60, lambda: ground.state(LEFT) == STANDBY and ground.state(RIGHT) == STANDBY)
    for peer in (ground, plane):
        peer.sign(None, 0)
    set_up(ground, bytes(32), "signing key cleared")
    assert Ground.set(plane, RIGHT, "LOSS_THR", 180) == 180, "without a key"
    print("signing: what is unsigned, signed with another key or sent again is ignored")


def main():
    listener = socket.socket()
    listener.bind(("127.0.0.1", 0))
    listener.listen()
    # The rig connects there, and is connected to on the port that comes back.
    print(f"listening {listener.getsockname()[1]}", flush=True)
    ground_port = int(sys.stdin.readline())
    plane = Plane(listener)
    ground = Ground(ground_port)
    discovery(ground, plane)
    parameters(ground, RIGHT, (NODE, LEFT, RIGHT), 20)
    refusals(ground, plane, RIGHT)
    mark = len(ground.received)
    flight(ground, plane)
    flight_of_the_other(ground, plane)
    record(ground, mark)
    cancelled(ground, RIGHT)
    restart(ground)
    emergency(ground, RIGHT, LEFT)
    signing(ground, plane)
    # A node that restarts cuts the frame that it was sending, once a port.
    for port in (ground, plane):
        cuts = port.cuts()
        assert len(cuts) <= RESTARTS, [(at, port.received[at]) for at in cuts]
    print("all as the documents have it")


if __name__ == "__main__":
    main()
