"""A real ArduPlane whose link to the rig becomes slow, as a radio's does: a list of parameters on that link, a radio that is full, gaps of
a stated length; then its death and return with a key for signing."""

import socket
import sys

from arduplane import AUTOPILOT, RUNNING, SERIAL1, STANDBY, Vehicle, follows
from peers import *
from pilot import KEY

# Of the source, and of the hold of its last demand, s: the defaults of SRC_MAV_TOUT and LOSS_HOLD.
TIMEOUT, HOLD = 1.0, 1.0
NONE, HOLDS, FAIL_SAFE = 0, 1, 2


class SlowVehicle(Vehicle):
    def __init__(self):
        super().__init__()
        with open(os.path.join(self.folder, "plane.parm"), "a") as file:
            file.write("SIM_BAUDLIMIT_EN 1\n")


class Relay:
    """The line between the rig and ArduPlane's second serial port. Frames pass whole; some are held back, and others are put in."""

    def __init__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.lock = threading.Lock()
        self.mav = mav.MAVLink(self, srcSystem=51, srcComponent=68)
        self.plane = None
        # When each SERVO_OUTPUT_RAW passed, and frames of the autopilot by whether they were signed.
        self.passed, self.signed = [], []
        self.holds, self.parameters = False, 0
        threading.Thread(target=self._run, daemon=True).start()

    def write(self, frame):
        self.plane.sendall(frame)

    def say(self, message):
        """Puts a frame in, to ArduPlane."""
        with self.lock:
            self.mav.send(message)

    def _run(self):
        while True:
            rig, _ = self.listener.accept()
            try:
                self.plane = socket.create_connection(("127.0.0.1", SERIAL1))
            except OSError:
                rig.close()
                continue
            back = threading.Thread(target=self._pump, args=(self.plane, rig, self._of_plane), daemon=True)
            back.start()
            self._pump(rig, self.plane, lambda message: True)
            back.join()

    def _pump(self, source, sink, passes):
        parser = mav.MAVLink(None)
        parser.robust_parsing = True
        try:
            while chunk := source.recv(4096):
                for message in parser.parse_buffer(chunk) or []:
                    if passes(message):
                        with self.lock:
                            sink.sendall(message.get_msgbuf())
        except OSError:
            pass
        for end in (source, sink):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def _of_plane(self, message):
        kind = message.get_type()
        if message.get_srcComponent() == AUTOPILOT:
            frame = message.get_msgbuf()
            self.signed.append(frame[0] == 0xFD and frame[2] & 1 == 1)
        self.parameters += kind == "PARAM_VALUE"
        if kind == "SERVO_OUTPUT_RAW":
            if self.holds:
                return False
            self.passed.append(time.monotonic())
        return True

    def gaps(self, since):
        """Between the frames of the stream since then, in the engines' time."""
        times = [at for at in self.passed if at >= since] + [time.monotonic()]
        return [(later - earlier) * SPEED for earlier, later in zip(times, times[1:])]


def stage(watch):
    return watch.last("HEARTBEAT", LEFT).custom_mode >> 16 & 3


def orders(watch, mark):
    return [efi.throttle_out for efi in watch.since(mark, "EFI_STATUS", LEFT)]


def losses(watch, mark):
    """Each text of the engine's source since then, with the node's time in s: named values come every 0.1 s, with theirs."""
    now, texts = None, []
    for message in watch.received[mark:]:
        if message.get_type() == "NAMED_VALUE_FLOAT":
            now = message.time_boot_ms / 1000
        elif message.get_type() == "STATUSTEXT" and message.text.startswith("left: source"):
            texts.append((now, message.text))
    return texts


def node_time(watch):
    mark = len(watch.received)
    return until("a time", 1, lambda: watch.since(mark, "NAMED_VALUE_FLOAT"))[0].time_boot_ms / 1000


def steady(watch, relay, mark, begin, highest):
    """What has to be so however slow the stream is: nothing jumps and nothing starts. Returns the longest gap and the rate."""
    came = orders(watch, mark)
    steps = [later - earlier for earlier, later in zip(came, came[1:])]
    # 5 % in the 0.1 s between two reports, and a report may be left out.
    assert max(came) <= highest + 0.5 and max(map(abs, steps)) <= 11, (max(came), max(steps), min(steps))
    assert (watch.state(LEFT), watch.state(RIGHT)) == (RUNNING, STANDBY)
    gaps = relay.gaps(begin)
    return max(gaps), len(gaps) / sum(gaps), min(came)


def slow_streams(vehicle, watch, relay):
    mark, begin = len(watch.received), time.monotonic()
    wait(10)
    gap, rate, _ = steady(watch, relay, mark, begin, 75)
    print(f"undisturbed: {rate:.0f} a second, longest gap {gap:.2f} s")
    assert rate > 30 and not losses(watch, mark)

    # All of its parameters, on our own link.
    before = relay.parameters
    relay.say(mav.MAVLink_param_request_list_message(VEHICLE, AUTOPILOT))
    until("the list begins", 10, lambda: relay.parameters > before + 20)
    mark, begin = len(watch.received), time.monotonic()
    wait(30)
    gap, rate, lowest = steady(watch, relay, mark, begin, 75)
    print(f"with a list of parameters: {rate:.1f} a second, longest gap {gap:.2f} s, order at least {lowest:.1f} %")
    assert rate < 20, "it was not slow"
    assert gap > TIMEOUT or (lowest > 74 and not losses(watch, mark))

    def ended():
        count = relay.parameters
        wait(3)
        return relay.parameters == count

    until("the list ends", 600, ended)

    # A radio that is full slows it down further with each of its reports.
    full = mav.MAVLink_radio_status_message(200, 200, 0, 0, 0, 0, 0)
    begin = time.monotonic()
    mark = len(watch.received)
    for _ in range(300):
        relay.say(full)
        wait(0.5)
        if max(relay.gaps(begin)) > TIMEOUT + 0.5:
            break
    begin = time.monotonic()
    for _ in range(60):
        relay.say(full)
        wait(0.5)
    gap, rate, lowest = steady(watch, relay, mark, begin, 75)
    texts = losses(watch, mark)
    print(f"with a full radio: {rate:.2f} a second, longest gap {gap:.2f} s, order at least {lowest:.1f} %")
    assert gap > TIMEOUT + 0.5 and any("hold" in text for _, text in texts), texts
    for (at, text), (later, what) in zip(texts, texts[1:]):
        assert ("hold" in text) != ("received again" in text) or "fail-safe" in text, texts
        assert "fail-safe" not in what or ("hold" in text and abs(later - at - HOLD) < 0.25), texts
    if not any("fail-safe" in text for _, text in texts):
        assert lowest > 74, "the demand is held"
    for _ in range(300):
        relay.say(mav.MAVLink_radio_status_message(200, 200, 100, 0, 0, 0, 0))
        wait(0.2)
        if max(relay.gaps(time.monotonic() - 3 / SPEED)) < 0.3:
            break
    until("left follows", 30, lambda: follows(vehicle.ground, watch, LEFT, "servo3_raw") and stage(watch) == NONE)
    print(f"texts of the source: {len(texts)}; the radio is empty: it follows")


def stated_gaps(watch, relay):
    """The stages at their times: a gap of 1.6 s is held, and one of 2.6 s goes to idle, and back without a jump."""
    for gap, stages in ((1.6, ["hold", "received again"]), (2.6, ["hold", "fail-safe", "received again"])):
        wait(3)
        mark, begin = len(watch.received), node_time(watch)
        relay.holds = True
        # What has passed reaches the node at once.
        wait(gap)
        relay.holds = False
        until("again", 5, lambda: any("received again" in text for _, text in losses(watch, mark)))
        wait(3)
        texts = losses(watch, mark)
        assert [word for word, (_, text) in zip(stages, texts) if word in text] == stages, texts
        assert len(texts) == len(stages), texts
        since = [at - begin for at, _ in texts]
        print(f"gap of {gap} s: " + ", ".join(f"{text[6:]} at {at:.1f} s" for at, (_, text) in zip(since, texts)))
        assert abs(since[0] - TIMEOUT) < 0.4, since
        assert len(stages) == 2 or abs(since[1] - since[0] - HOLD) < 0.25, since
        _, _, lowest = steady(watch, relay, mark, time.monotonic() - 1, 75)
        if len(stages) == 2:
            assert lowest > 74, "the demand is held"
        else:
            # 50 % a second, until the source has been received without a gap for 1 s, and has taken over.
            assert lowest < 50, lowest
        until("left follows", 10, lambda: watch.last("EFI_STATUS", LEFT).throttle_out > 74)


def at_idle(watch, left, right):
    came = 0
    for _ in range(100):
        wait(0.1)
        came = max(came, watch.last("EFI_STATUS", LEFT).throttle_out)
    assert came == 0 and (watch.state(LEFT), watch.state(RIGHT)) == (left, right), came


def with_a_key(vehicle, watch, relay):
    """Everything signed: killed in flight, it comes back with the key that it has stored."""
    vehicle.throttle = 1000
    assert vehicle.ground.command(LEFT, START, 0)[0] == ACCEPTED
    vehicle.arm(False)
    until("at rest", 400, lambda: watch.state(LEFT) == STANDBY and watch.last("EFI_STATUS", LEFT).rpm < 500)
    # By the clock of the day, as its GPS has it. Its time passes faster here, so the ground station is an hour ahead.
    stamp = lambda ahead=0: int((time.time() + ahead - 1_420_070_400) * 1e5)
    for peer, component in ((vehicle.ground, AUTOPILOT), (watch, NODE)):
        peer.say(mav.MAVLink_setup_signing_message(VEHICLE, component, list(KEY), stamp()))
    until("its key", 5, lambda: "signing key set" in "".join(said.text for said in watch.since(0, "STATUSTEXT", NODE)))
    until("the autopilot signs", 5, lambda: all(relay.signed[-20:]))
    # A new sender has to be ahead of the node's clock, or less than a minute behind: the autopilot is known first.
    wait(5)
    vehicle.ground.sign(KEY, stamp(3600))

    def flown():
        vehicle.throttle = 1000
        vehicle.arm(True)
        wait(3)
        if watch.state(LEFT) == STANDBY:
            answer, text = vehicle.ground.command(LEFT, START, 1)
            assert answer == ACCEPTED, (answer, text)
            until("running", 120, lambda: watch.state(LEFT) == RUNNING)
        vehicle.throttle = 1750
        until("left follows", 30, lambda: watch.last("EFI_STATUS", LEFT).throttle_out > 74)
        assert watch.state(RIGHT) == STANDBY

    flown()
    vehicle.kill()
    until("fail-safe throttle", 15, lambda: watch.last("EFI_STATUS", LEFT).throttle_out == 0)
    begin = len(relay.signed)
    vehicle.start()
    vehicle.ground.sign(KEY, stamp(3600))
    until("the components", 30, lambda: vehicle.ground.last("HEARTBEAT", LEFT))
    at_idle(watch, RUNNING, STANDBY)
    flown()
    signed = relay.signed[begin:]
    assert len(signed) > 200 and all(signed), (len(signed), sum(signed))
    counters = {value.name for value in watch.since(0, "NAMED_VALUE_FLOAT", NODE)}
    assert not counters & {"badsigned", "replayed", "clockback"}, counters
    print("with a key: killed in flight, idle; come back: no jump, no start; armed: it follows")


def main():
    vehicle = SlowVehicle()
    try:
        vehicle.start()
        relay = Relay()
        print(f"listening {relay.port}", flush=True)
        watch = Ground(int(sys.stdin.readline()))
        ground = vehicle.ground
        until("all components", 30, lambda: all(ground.last("HEARTBEAT", c) for c in (NODE, LEFT, RIGHT)))
        until("standby", 60, lambda: watch.state(LEFT) == watch.state(RIGHT) == STANDBY)
        vehicle.arm(True)
        wait(3)
        answer, text = ground.command(LEFT, START, 1)
        assert answer == ACCEPTED, (answer, text)
        until("running", 120, lambda: watch.state(LEFT) == RUNNING)
        vehicle.throttle = 1750
        until("left follows", 20, lambda: watch.last("EFI_STATUS", LEFT).throttle_out > 74)
        wait(3)
        slow_streams(vehicle, watch, relay)
        stated_gaps(watch, relay)
        with_a_key(vehicle, watch, relay)
        print("flown by a real ArduPlane on a slow link")
    finally:
        vehicle.end()


if __name__ == "__main__":
    main()
