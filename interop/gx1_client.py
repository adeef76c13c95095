#!/usr/bin/env python3
"""Plays a client of the 3DM-GX1 against `simulate --imu-pty`, with nothing but the system's terminal calls.

    gx1_client.py /tmp/imu

Every command of the published tables is asked once; header, length and checksum of each answer are checked, the
three forms of the attitude against each other, the gains in the EEPROM against the size of gravity, the tick
counter of a stream against the cycle, and that a listener at another speed understands nothing.
"""

import math
import os
import select
import struct
import sys
import termios
import time

SPEEDS = {19200: termios.B19200, 38400: termios.B38400, 115200: termios.B115200}
# Command, bytes of the request, bytes of the answer.
TABLE = {
    0x01: ("01", 23), 0x02: ("02", 23), 0x03: ("03", 23), 0x04: ("04", 13), 0x05: ("05", 13), 0x07: ("07", 7),
    0x0A: ("0A", 23), 0x0B: ("0B", 23), 0x0C: ("0C", 31), 0x0D: ("0D", 11), 0x0E: ("0E", 11), 0x12: ("12", 31),
    0x0F: ("0F C1 C3 C5", 5), 0x11: ("11 C1 C3 C5", 5), 0x25: ("25", 11), 0x27: ("27", 5), 0x28: ("28 00 82", 7),
    0x29: ("29 71 00 7C 01 F4 AA", 7), 0x31: ("31", 23), 0x40: ("40 71 3E", 5), 0x41: ("41", 23),
    0x42: ("42 71 3E 00 00 00", 11), 0xF0: ("F0", 5), 0xF1: ("F1", 5),
}


class Line:
    def __init__(self, path, baud):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        raw = termios.tcgetattr(self.fd)
        raw[0] = raw[1] = raw[3] = 0
        raw[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
        raw[4] = raw[5] = SPEEDS[baud]
        termios.tcsetattr(self.fd, termios.TCSANOW, raw)

    def send(self, text):
        os.write(self.fd, bytes.fromhex(text))

    def read(self, count, seconds=5.0):
        got = b""
        end = time.monotonic() + seconds
        while len(got) < count:
            left = end - time.monotonic()
            if left <= 0 or not select.select([self.fd], [], [], left)[0]:
                break
            got += os.read(self.fd, count - len(got))
        return got

    def ask(self, text, count):
        self.send(text)
        answer = self.read(count)
        assert len(answer) == count, f"{text}: {len(answer)} of {count} bytes"
        return check(answer)


def check(packet):
    """Words between header and sum."""
    words = struct.unpack(f">{(len(packet) - 1) // 2}H", packet[1:])
    total = (packet[0] + sum(words[:-1])) & 0xFFFF
    assert total == words[-1], f"{packet.hex()}: sum {total:04x}"
    return list(words[:-1])


def signed(word):
    return word - 0x10000 if word & 0x8000 else word


def euler_of_quaternion(words):
    w, x, y, z = (signed(q) / 8192 for q in words)
    assert abs(w * w + x * x + y * y + z * z - 1) < 1e-3
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1, min(1, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def euler_of_matrix(words):
    m = [signed(word) / 8192 for word in words]  # column by column, v_device = M v_earth
    m11, m21, m31, m12, m22, m32, m13, m23, m33 = m
    return math.atan2(m23, m33), math.asin(max(-1, min(1, -m13))), math.atan2(m12, m11)


def main(path):
    line = Line(path, 38400)
    line.send("10 00 00")
    answer = line.read(7)
    assert answer[:1] == b"\x10" and check(answer)[0] == 0, answer.hex()
    for command, (request, count) in TABLE.items():
        line.send(request)
        answer = line.read(count)
        assert len(answer) == count and answer[0] == command, f"{request}: {answer.hex()}"
        check(answer)
        assert not line.read(1, 0.05), f"{request}: more than {count} bytes"
    line.send("08 82")
    assert struct.unpack(">H", line.read(2)) == (10000,)

    accel_gain = line.ask("28 00 E6", 7)[0]
    euler = [signed(word) * 2 * math.pi / 65536 for word in line.ask("0E", 11)[:3]]
    for other in (euler_of_quaternion(line.ask("05", 13)[:4]), euler_of_matrix(line.ask("0B", 23)[:9])):
        assert all(abs(a - b) < 4e-4 for a, b in zip(euler, other)), (euler, other)
    accel = [signed(word) * accel_gain / 32768000 * 9.81 for word in line.ask("03", 23)[3:6]]
    size = math.sqrt(sum(a * a for a in accel))
    assert abs(size - 9.81) < 0.25 and accel[2] < -9.0, accel

    factors = [line.ask(f"28 00 {cell:02X}", 7)[0] for cell in (238, 240, 242, 246)]
    tick = math.prod(factors) * 1e-7
    assert abs(tick - 6.5536e-3) < 1e-9, factors
    line.send("10 00 31")
    assert check(line.read(7))[0] == 0x31
    begun = time.monotonic()
    ticks = []
    for _ in range(100):
        packet = line.read(23)
        assert packet[:1] == b"\x31" and len(packet) == 23, packet.hex()
        ticks.append(check(packet)[-1])
    took = time.monotonic() - begun
    steps = {(b - a) & 0xFFFF for a, b in zip(ticks, ticks[1:])}
    assert steps == {3}, steps
    # 100 cycles of three ticks; a loaded host may be late, the unit is not early.
    assert took > 0.95 * 99 * 3 * tick, took
    # Who listens at another speed understands nothing, and is not understood.
    wrong = Line(path, 115200)
    garbled = wrong.read(230, 3)
    assert b"\x31" * 3 not in garbled and len(garbled) > 50
    good = sum(
        garbled[i] == 0x31 and struct.unpack(">11H", garbled[i + 1:i + 23])[-1]
        == (0x31 + sum(struct.unpack(">11H", garbled[i + 1:i + 23])[:-1])) & 0xFFFF
        for i in range(len(garbled) - 23)
    )
    assert good == 0
    os.close(wrong.fd)
    line = Line(path, 38400)
    line.send("10 00 00")
    tail = line.read(4000, 0.5)
    assert tail[-7] == 0x10 and check(tail[-7:])[0] == 0, tail[-16:].hex()
    assert not line.read(1, 0.3)
    print(f"{len(TABLE) + 1} commands of a 3DM-GX1, 100 packets streamed, one every {1e3 * took / 100:.2f} ms")


if __name__ == "__main__":
    main(sys.argv[1])
