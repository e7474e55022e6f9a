"""Peers of the rig, on pymavlink: a ground station that connects, and a simulated autopilot that is connected to."""

import os
import socket
import struct
import threading
import time

os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as mav  # noqa: E402

SPEED = int(os.environ.get("SPEED", "1"))
VEHICLE = int(os.environ.get("VEHICLE", "3"))
NODE, LEFT, RIGHT = 25, 26, 27
ACCEPTED, NOT_NOW, DENIED, UNSUPPORTED, CANCELLED = 0, 1, 2, 3, 6
START, USER, TERMINATE, REBOOT, INTERVAL = 223, 31010, 185, 246, 511


def wait(seconds):
    """Waits for a time of the engines."""
    time.sleep(seconds / SPEED)


# Wall-clock time that anything may take: the computer may be busy.
PATIENCE = 5


# Messages after a cut frame among which pymavlink reports what is left of it, and of the frames that it took for its end: it reported
# up to seven times among 15 messages, where 5000 cuts were tried at random.
PIECES = 15


def until(what, seconds, done):
    """Waits until it is so."""
    end = time.monotonic() + max(seconds / SPEED, PATIENCE)
    while True:
        result = done()
        if result:
            return result
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.005)


class CommandCancel(mav.MAVLink_message):
    """COMMAND_CANCEL, which pymavlink does not have."""

    def __init__(self, system, component, command):
        super().__init__(80, "COMMAND_CANCEL")
        self.payload = struct.pack("<HBB", command, system, component)

    def pack(self, to, force_mavlink1=False):
        return self._pack(to, 14, self.payload, force_mavlink1=force_mavlink1)


class Peer:
    """One end of a TCP connection, with a thread that reads and one that repeats."""

    def __init__(self, connection, system, component):
        self.connection = connection
        self.lock = threading.Lock()
        self.mav = mav.MAVLink(self, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.parser = mav.MAVLink(None)
        self.parser.robust_parsing = True
        self.received = []
        threading.Thread(target=self._read, daemon=True).start()

    def write(self, frame):
        self.connection.sendall(frame)

    def sign(self, key, stamp):
        """Signs what is sent from here on, and takes only what is signed. Without a key: neither."""
        with self.lock:
            for end in (self.mav, self.parser):
                end.signing.secret_key = key
                end.signing.sign_outgoing = key is not None
                end.signing.timestamp = stamp

    def say(self, message):
        with self.lock:
            self.mav.send(message)

    def _read(self):
        while True:
            try:
                chunk = self.connection.recv(4096)
            except OSError:
                return
            if not chunk:
                return
            with self.lock:
                messages = self.parser.parse_buffer(chunk) or []
            for message in messages:
                # A port may be joined in the middle of a frame.
                if self.received or message.get_type() != "BAD_DATA":
                    self.received.append(message)
                self.on(message)

    def on(self, message):
        pass

    def repeat(self, every, what):
        def run():
            while True:
                try:
                    what()
                except OSError:
                    return
                wait(every)

        threading.Thread(target=run, daemon=True).start()

    def since(self, mark, kind, component=None):
        return [
            message
            for message in self.received[mark:]
            if message.get_type() == kind and component in (None, message.get_srcComponent())
        ]

    def cuts(self):
        """Where in `received` a frame was cut: the messages that came first. The one in whose middle the port was joined is not there."""
        cuts = []
        for at, message in enumerate(self.received):
            if message.get_type() == "BAD_DATA" and at > (cuts[-1] if cuts else 0) + PIECES:
                cuts.append(at)
        return cuts

    def last(self, kind, component):
        for message in reversed(self.received):
            if message.get_type() == kind and message.get_srcComponent() == component:
                return message
        return None


class Ground(Peer):
    """A ground station: system 255."""

    def __init__(self, port, system=255):
        for _ in range(200):
            try:
                connection = socket.create_connection(("127.0.0.1", port))
                break
            except ConnectionRefusedError:
                time.sleep(0.05)
        super().__init__(connection, system, 190)
        self.repeat(1, lambda: self.say(mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))

    def command(self, component, command, *params, system=VEHICLE, confirmation=0, answered=True):
        """Sends a command. Returns its answer and the texts that came with it."""
        mark = len(self.received)
        params = (list(params) + [0] * 7)[:7]
        self.say(mav.MAVLink_command_long_message(system, component, command, confirmation, *params))
        if answered:
            until(f"an answer to {command}", 1, lambda: self.since(mark, "COMMAND_ACK"))
        time.sleep(0.1 if answered else 0.5)
        acks = [ack for ack in self.since(mark, "COMMAND_ACK") if ack.command == command]
        assert len(acks) <= 1, acks
        texts = "".join(text.text for text in self.since(mark, "STATUSTEXT"))
        for ack in acks:
            assert (ack.get_srcSystem(), ack.get_srcComponent()) == (system, component)
            assert (ack.target_system, ack.target_component) == (self.mav.srcSystem, 190)
        return (acks[0].result if acks else None), texts

    def read(self, component, name):
        mark = len(self.received)
        self.say(mav.MAVLink_param_request_read_message(VEHICLE, component, name.encode(), -1))
        return until(name, 2, lambda: self.since(mark, "PARAM_VALUE", component))[0].param_value

    def set(self, component, name, value):
        mark = len(self.received)
        self.say(mav.MAVLink_param_set_message(VEHICLE, component, name.encode(), value, 9))
        echo = until(name, 2, lambda: self.since(mark, "PARAM_VALUE", component))[0]
        return echo.param_value

    def state(self, component):
        beat = self.last("HEARTBEAT", component)
        return beat and beat.custom_mode & 0xFF


class Plane(Peer):
    """An autopilot that grants its outputs every 25 ms."""

    def __init__(self, listener):
        listener.settimeout(20)
        connection, _ = listener.accept()
        connection.settimeout(None)
        self.armed = False
        self.alive = True
        self.pulse = 1100
        self.requests = []
        self.started = time.monotonic()
        super().__init__(connection, VEHICLE, 1)
        self.repeat(1, self._beat)
        self.repeat(0.025, self._outputs)

    def _beat(self):
        if self.alive:
            self.say(mav.MAVLink_heartbeat_message(1, 3, 129 if self.armed else 1, 0, 4, 3))

    def _outputs(self):
        if self.alive and self.requests:
            usec = int((time.monotonic() - self.started) * SPEED * 1e6) & 0xFFFFFFFF
            self.say(mav.MAVLink_servo_output_raw_message(usec, 0, 0, 0, self.pulse, 0, 0, 0, 0, 0))

    def on(self, message):
        if message.get_type() == "COMMAND_LONG" and message.command == INTERVAL:
            assert (message.param1, message.target_system, message.target_component) == (36, VEHICLE, 1)
            granted = message.param2 >= 25_000
            if granted:
                self.requests.append(message.param2)
            self.say(
                mav.MAVLink_command_ack_message(
                    INTERVAL, 0 if granted else 2, 0, 0, message.get_srcSystem(), message.get_srcComponent()
                )
            )
