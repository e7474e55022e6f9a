"""Whether each EFI_STATUS was what the engine's ECU had sent: `efi.py CAPTURE LOG ENGINE...`, a folder of `jetlink rig --capture` or
`cargo emu-run --capture`, a file of pilot.py, and which engines are in it. The bytes are read here by the documents of the protocols (docs/protocols.md), and not with the node's code."""

import os
import sys


def crc8(data):
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0x8C if crc & 1 else crc >> 1
    return crc


def zk(data):
    """What is known after each frame: rpm, EGT in °C, fuel flow in ml/min, throttle in %."""
    egt = flow = throttle = 0
    at = 0
    while at + 7 <= len(data):
        head, low, high, b3, b4, b5, crc = data[at : at + 7]
        if head >> 4 != 0xF or crc8(data[at : at + 6]) != crc:
            at += 1
            continue
        at += 7
        kind = head & 0xF
        if kind == 1:
            egt = ((b4 >> 2 & 7) << 8 | b5) - 50
        elif kind == 3:
            throttle = b3
        elif kind == 7:
            flow = ((b4 & 3) << 8 | b3) * 10
        yield (high << 8 | low) * 10, egt, flow, throttle


def amt(data):
    """The same of an Olympus, which reports no fuel flow."""
    for frame in data.split(b"\xff"):
        if len(frame) == 5 and frame[0] & 7 in (1, 2, 4):
            yield frame[1] * 500, frame[2] * 4.6 - 50, 0, frame[3] / 2


ENGINES = {"left": ("26", amt), "right": ("27", zk)}
# Of a value in these messages: the ECUs' own steps are larger.
RESOLUTION = 0.05


def main(capture, log, *engines):
    messages = {ENGINES[name][0]: [] for name in engines}
    with open(log) as lines:
        for line in lines:
            component, *values = line.split()
            messages[component].append([float(value) for value in values])
    for name in engines:
        component, read = ENGINES[name]
        with open(os.path.join(capture, f"{name}-from-ecu.bin"), "rb") as file:
            sent = list(read(file.read()))
        # In the order of the bytes: none is older than the one before it.
        at = 0
        for message in messages[component]:
            begin = at
            while not all(abs(is_ - was) < RESOLUTION for is_, was in zip(message, sent[at])):
                at += 1
                assert at < len(sent), f"{name}: EFI_STATUS {message}, after {sent[begin]} the ECU never sent that"
        speeds = [rpm for rpm, *_ in messages[component]]
        different = len({tuple(message) for message in messages[component]})
        assert min(speeds) < 1000 and max(speeds) > 40_000 and different > 50, (speeds, different)
        print(f"{name}: {len(speeds)} EFI_STATUS up to {max(speeds):.0f} rpm, {different} of them different, as the ECU sent")


if __name__ == "__main__":
    main(*sys.argv[1:])
