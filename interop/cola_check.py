"""Compares scan-capture's CSV with an independent decode of the same recording.

usage: cola_check.py RECORDING.cola SCANS.csv

Written from SICK's telegram listing, not from the Rust decoder: every scan's head, channels and
last blocks must agree, value by value. Knows CoLa A and CoLa B.
"""
import calendar
import csv
import math
import struct
import sys
from functools import reduce
from operator import xor


def bodies(data):
    """Every telegram's (is_text, body)."""
    at = 0
    while at < len(data):
        if data[at:at + 4] == b"\2\2\2\2":
            (length,) = struct.unpack(">I", data[at + 4:at + 8])
            body = data[at + 8:at + 8 + length]
            assert reduce(xor, body) == data[at + 8 + length], f"XOR at {at}"
            yield False, body
            at += 9 + length
        else:
            assert data[at] == 2, f"no telegram at {at}"
            end = data.index(3, at)
            yield True, data[at + 1:end]
            at = end + 1


class Text:
    def __init__(self, body):
        self.rest = body.decode("latin-1")[len("sSN LMDscandata "):]

    def word(self):
        word, _, self.rest = self.rest.partition(" ")
        return word

    def u(self, size):
        return int(self.word(), 16)

    def i(self, size):
        value = int(self.word(), 16)
        return value - (1 << 32) if value >> 31 else value

    def real(self):
        return struct.unpack(">f", bytes.fromhex(self.word().zfill(8)))[0]

    def chars(self, count):
        chars, self.rest = self.rest[:count], self.rest[count + 1:]
        return chars

    def left(self):
        return len(self.rest)


class Binary:
    def __init__(self, body):
        self.rest = body[len("sSN LMDscandata "):]

    def take(self, code):
        size = struct.calcsize(code)
        (value,), self.rest = struct.unpack(code, self.rest[:size]), self.rest[size:]
        return value

    def u(self, size):
        return self.take({1: ">B", 2: ">H", 4: ">I"}[size])

    def i(self, size):
        return self.take(">i")

    def real(self):
        return self.take(">f")

    def chars(self, count):
        return self.take(f"{count}s").decode("latin-1")

    def left(self):
        return len(self.rest)


def decode(f):
    t = {}
    for name, size in [("version", 2), ("device_number", 2), ("serial_number", 4)]:
        t[name] = f.u(size)
    t["device_status"] = f.u(1) | f.u(1) << 8
    t["telegram_counter"], t["scan_counter"] = f.u(2), f.u(2)
    t["tick"], t["transmit"] = f.u(4), f.u(4)
    t["inputs"] = f.u(1) | f.u(1) << 8
    t["outputs"] = f.u(1) | f.u(1) << 8
    t["layer"] = f.u(2)
    t["scan_frequency_hz"], t["measurement_frequency_hz"] = f.u(4) / 100, f.u(4) * 100
    t["encoder"] = [f.u(size) for _ in range(f.u(2)) for size in (4, 2)]
    t["channels"] = {}
    for size in (2, 1):
        for _ in range(f.u(2)):
            name = f.chars(5)
            head = dict(scale=f.real(), offset=f.real(), start=f.i(4), step=f.u(2))
            head["raw"] = [f.u(size) for _ in range(f.u(2))]
            t["channels"][name] = head
    assert f.u(2) == 0, "a position block is not expected here"
    t["device_name"] = f.chars(f.u(2)) if f.u(2) else ""
    t["comment"] = f.chars(f.u(2)) if f.u(2) else ""
    t["time_ns"] = None
    if f.u(2):
        y, mo, d, h, mi, s, us = f.u(2), f.u(1), f.u(1), f.u(1), f.u(1), f.u(1), f.u(4)
        t["time_ns"] = calendar.timegm((y, mo, d, h, mi, s)) * 10**9 + us * 1000
    assert f.u(2) == 0, "an event is not expected here"
    assert f.left() == 0, f"{f.left()} bytes left over"
    return t


def same(row, name, want):
    got = row.get(name, "")
    ok = got == "" if want in ("", None) else (
        got == want if isinstance(want, str) else math.isclose(float(got), want, rel_tol=1e-12, abs_tol=1e-12))
    assert ok, f"{name}: {got!r}, not {want!r}"


def ranges_agree(row, column, channel):
    got = row.get(column, "").split()
    assert len(got) == len(channel["raw"]), f"{column}: {len(got)} values"
    for text, raw in zip(got, channel["raw"]):
        want = "inf" if raw == 0 else "nan" if raw < 16 else None
        value = raw * channel["scale"] + channel["offset"]
        assert text == want if want else float(text) == value, f"{column}: {text}, raw {raw}"


def compare(row, t):
    for name in ("version", "device_number", "serial_number", "device_status", "telegram_counter",
                 "scan_counter", "inputs", "outputs", "layer", "scan_frequency_hz",
                 "measurement_frequency_hz", "device_name", "comment"):
        same(row, name, t[name])
    same(row, "device_time_ns", str(t["time_ns"]) if t["time_ns"] is not None else None)
    # Both ticks come unwrapped: their low 32 bits were sent.
    device_us, transmit_us = int(row["device_ns"]) // 1000, int(row["transmit_ns"]) // 1000
    assert device_us % 2**32 == t["tick"] and int(row["device_ns"]) % 1000 == 0, "device_ns"
    assert transmit_us - device_us == (t["transmit"] - t["tick"]) % 2**32, "transmit_ns"
    same(row, "encoder", " ".join(map(str, t["encoder"])))
    first = t["channels"]["DIST1"]
    step = 2 / round(20000 / first["step"])
    same(row, "angle_increment_rad", math.radians(step))
    same(row, "angle_min_rad", math.radians(round(first["start"] / 1e4 / (step / 2)) * step / 2))
    same(row, "angular_step_raw", first["step"])
    same(row, "start_angle_raw", first["start"])
    same(row, "scale", first["scale"])
    period = float(row["scan_time_s"])
    same(row, "time_increment_s", step / 360 * period)
    assert abs(period * t["scan_frequency_hz"] - 1) < 0.02, f"period {period}"
    for name, channel in t["channels"].items():
        echo = "" if name[4] == "1" else "_" + name[4]
        if name.startswith("DIST"):
            ranges_agree(row, f"ranges{echo}_mm", channel)
        else:
            got = [float(text) for text in row[f"remissions{echo}"].split()]
            assert got == [float(raw) for raw in channel["raw"]], name


def main(recording, scans):
    csv.field_size_limit(1 << 24)
    with open(recording, "rb") as file:
        data = file.read()
    wanted, last = [], None
    for is_text, body in bodies(data):
        if body[:16] in (b"sSN LMDscandata ", b"sRA LMDscandata "):
            t = decode(Text(body) if is_text else Binary(body))
            key = (t["serial_number"], t["scan_counter"], t["tick"])
            if key != last:
                wanted.append(t)
            last = key
    with open(scans, newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(wanted), f"{len(rows)} rows, {len(wanted)} scans"
    for number, (row, t) in enumerate(zip(rows, wanted)):
        try:
            compare(row, t)
        except AssertionError as fault:
            sys.exit(f"{recording}: scan {number}: {fault}")
    print(f"{recording}: {len(rows)} scans agree in every field")


if __name__ == "__main__":
    main(*sys.argv[1:3])
