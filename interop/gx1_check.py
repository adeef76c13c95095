"""Compares imu-read's decoding of a 3DM-GX1's replies with an independent one.

usage: gx1_check.py DIRECTORY [PACKETS]

Written from the maker's protocol and from public drivers' tables, not from the Rust decoder. Makes
PACKETS random replies of every kind (a million by default), writes them as a byte stream, has
imu-read list them, and compares every word and every value: words exactly, values to 1e-15.
"""
import math
import random
import struct
import subprocess
import sys

GAINS = {"accel": 7321, "rate": 9876, "mag": 2111}

X, Y, Z = "xyz"
XYZ = [X, Y, Z]
MATRIX = ["11", "21", "31", "12", "22", "32", "13", "23", "33"]
MAG = [("mag", axis) for axis in XYZ]
ACCEL = [("accel", axis) for axis in XYZ]
RATE = [("rate", axis) for axis in XYZ]
RAW = [("raw", kind + axis) for kind in ("mag", "accel", "rate") for axis in XYZ]
QUATERNION = [("q", i) for i in range(4)]
EULER = [("angle", name) for name in ("roll", "pitch", "yaw")]
T = [("ticks", "")]
VALUE = [("value", 0)]

# Command: words before the sum.
LAYOUTS = {
    0x01: RAW + T,
    0x02: MAG + ACCEL + RATE + T,
    0x03: MAG + ACCEL + RATE + T,
    0x04: QUATERNION + T,
    0x05: QUATERNION + T,
    0x06: T,
    0x07: [("temperature", "")] + T,
    0x0A: [("m", place) for place in MATRIX] + T,
    0x0B: [("m", place) for place in MATRIX] + T,
    0x0C: QUATERNION + MAG + ACCEL + RATE + T,
    0x0D: EULER + T,
    0x0E: EULER + T,
    0x0F: T,
    0x10: VALUE + T,
    0x11: T,
    0x12: QUATERNION + MAG + ACCEL + RATE + T,
    0x24: T,
    0x25: [("value", i) for i in range(3)] + T,
    0x27: VALUE,
    0x28: VALUE + T,
    0x29: VALUE + T,
    0x31: EULER + ACCEL + RATE + T,
    0x40: T,
    0x41: MAG + MAG + MAG + T,
    0x42: MAG + T,
    0xF0: VALUE,
    0xF1: VALUE,
}
# Bytes of each reply, as printed.
LENGTHS = {
    0x01: 23, 0x02: 23, 0x03: 23, 0x04: 13, 0x05: 13, 0x06: 5, 0x07: 7, 0x0A: 23, 0x0B: 23,
    0x0C: 31, 0x0D: 11, 0x0E: 11, 0x0F: 5, 0x10: 7, 0x11: 5, 0x12: 31, 0x24: 5, 0x25: 11, 0x27: 5,
    0x28: 7, 0x29: 7, 0x31: 23, 0x40: 5, 0x41: 23, 0x42: 11, 0xF0: 5, 0xF1: 5,
}


def signed(word):
    return word - 65536 if word >= 32768 else word


def value(kind, word):
    if kind == "mag":
        return signed(word) * GAINS["mag"] / 32768000
    if kind == "rate":
        return signed(word) * GAINS["rate"] / 32768000
    if kind == "accel":
        return signed(word) * GAINS["accel"] / 32768000 * 9.81
    if kind in ("q", "m"):
        return signed(word) / 8192
    if kind == "angle":
        return math.radians(signed(word) * 360 / 65536)
    if kind == "temperature":
        return (word * 5 / 65536 - 0.5) * 100
    return float(word)


def main():
    directory = sys.argv[1]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000
    rng = random.Random(11)
    commands = list(LAYOUTS)
    for command in commands:
        assert 1 + 2 * len(LAYOUTS[command]) + 2 == LENGTHS[command], hex(command)
    path = f"{directory}/random.gx1"
    sent = []
    with open(path, "wb") as out:
        for k in range(count):
            command = commands[k % len(commands)]
            n = len(LAYOUTS[command])
            words = struct.unpack(f">{n}H", rng.randbytes(2 * n))
            total = (command + sum(words)) % 65536
            out.write(struct.pack(f">B{n}HH", command, *words, total))
            sent.append((command, words))
    gains = f"{GAINS['accel']},{GAINS['rate']},{GAINS['mag']}"
    reader = subprocess.Popen(
        ["imu-read", "replay", path, "--packets", "--gains", gains],
        stdout=subprocess.PIPE, text=True,
    )
    header = next(reader.stdout).strip().split(",")
    at = {name: i for i, name in enumerate(header)}
    place = compared = 0
    for (command, words), row in zip(sent, reader.stdout):
        fields = row.rstrip("\n").split(",")
        layout = LAYOUTS[command]
        assert int(fields[at["offset"]]) == place, row
        assert fields[at["command"]] == f"0x{command:02X}", row
        assert fields[at["words"]] == " ".join(map(str, words)), row
        got = fields[at["values"]].split(" ")
        assert len(got) == len(words), row
        for text, word, (kind, _) in zip(got, words, layout):
            want = value(kind, word)
            assert abs(float(text) - want) <= 1e-15 * abs(want), (row, kind, want)
        ticks = str(words[-1]) if layout[-1] == T[0] else ""
        assert fields[at["ticks"]] == ticks, row
        place += LENGTHS[command]
        compared += len(words)
    assert reader.stdout.read() == "" and reader.wait() == 0
    print(f"{count} replies of {len(commands)} kinds, {compared} words and values: all the same")


main()
