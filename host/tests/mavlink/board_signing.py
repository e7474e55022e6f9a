"""A pilot written from the MAVLink documents, against an image with signing on an emulated board, whose F-RAM has a key: what is signed
with it acts, and what is unsigned, signed with another key or sent again does not. In real time, at the telemetry UART."""

import sys

from board import Line, discovery
from peers import *
from pilot import KEY, RUNNING, STAMP, STANDBY, START_REQUESTED, STARTING

UNDER_WAY = (START_REQUESTED, STARTING, RUNNING)
# Of a stamp: the clock of ground station and autopilot, behind which that of the image's F-RAM is.
MINUTE = 6_000_000


def threshold(value):
    return mav.MAVLink_param_set_message(VEHICLE, LEFT, b"LOSS_THR", value, 9)


def engine(run):
    return mav.MAVLink_command_long_message(VEHICLE, LEFT, START, 0, run, 0, 0, 0, 0, 0, 0)


def packed(line, message):
    """A frame signed as what the ground station sends next."""
    with line.lock:
        return message.pack(line.mav)


def written(line, frame):
    """Sends a frame. Returns what is answered to it."""
    mark = len(line.received)
    with line.lock:
        line.write(frame)
    wait(1.5)
    return line.since(mark, "PARAM_VALUE") + line.since(mark, "COMMAND_ACK")


def main():
    line = Line(int(sys.argv[1]))
    # Unsigned frames before the peers have the key: of them no vehicle is learnt, and nothing is sent.
    unsigned = {"set": threshold(200).pack(line.mav), "start": engine(1).pack(line.mav)}
    unsigned["stop"] = engine(0).pack(line.mav)
    wait(10)
    assert not line.received, [str(message) for message in line.received[:3]]
    line.sign(KEY, STAMP + MINUTE)
    discovery(line)

    # Settings.
    assert line.set(LEFT, "SRC_MAV_TOUT", 20_000) == 20_000, "a busy computer is no lost source"
    assert line.set(LEFT, "LOSS_THR", 100) == 100
    good = packed(line, threshold(110))
    answers = written(line, good)
    assert [answer.param_value for answer in answers] == [110], answers
    assert line.set(LEFT, "LOSS_THR", 120) == 120
    stranger = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    stranger.signing.secret_key, stranger.signing.sign_outgoing = KEY[::-1], True
    stranger.signing.timestamp = STAMP * 2
    altered = bytearray(packed(line, threshold(130)))
    altered[-1] ^= 1
    for what, frame in (
        ("unsigned", unsigned["set"]),
        ("another key", threshold(140).pack(stranger)),
        ("altered", bytes(altered)),
        ("replayed", good),
    ):
        assert written(line, frame) == [], what
        assert line.read(LEFT, "LOSS_THR") == 120, what

    # Commands: a start, and what does not stop it; a stop, and what does not start it again.
    line.armed = True
    wait(4)
    started = packed(line, engine(1))
    assert [ack.result for ack in written(line, started)] == [ACCEPTED]
    until("under way", 20, lambda: line.state(LEFT) in UNDER_WAY)
    assert written(line, unsigned["stop"]) == []
    assert written(line, engine(0).pack(stranger)) == []
    assert line.state(LEFT) in UNDER_WAY
    assert [ack.result for ack in written(line, packed(line, engine(0)))] == [ACCEPTED]
    until("stopped", 5, lambda: line.state(LEFT) not in UNDER_WAY)
    for what in (started, unsigned["start"]):
        assert written(line, what) == []
        assert line.state(LEFT) not in UNDER_WAY

    # What was ignored is counted.
    for name, least in (("unsigned", 5), ("badsigned", 3), ("replayed", 2)):

        def counted():
            values = [value.value for value in line.since(0, "NAMED_VALUE_FLOAT", NODE) if value.name == name]
            return values and values[-1] >= least and values

        print(f"{name}: {until(name, 15, counted)[-1]:.0f}")
    unsigned = [message for message in line.received if not message.get_signed()]
    assert not unsigned and len(line.received) > 100, (len(unsigned), str(unsigned[:3]))
    print("all as the documents have it")


if __name__ == "__main__":
    main()
