"""A scanner's client that shares no code with the kit: it plays the start-up of the maker's driver
(sick_scan_xd) against `simulate --serve`, in either dialect, checks every reply to the byte where it
is not a clock, and decodes two seconds of scans.

    python3 sick_client.py HOST:PORT [--dialect a|b] [--seconds 2]

Written from the telegram layout alone; only the standard library is used.
"""

import argparse
import math
import socket
import struct
import sys
import time


def fail(text):
    print(f"sick_client: {text}", file=sys.stderr)
    sys.exit(1)


class Telegrams:
    """Cuts the stream into telegrams; anything else is an error."""

    def __init__(self, sock, binary):
        self.sock, self.binary, self.buffer = sock, binary, b""
        self.waiting = []

    def send(self, body):
        if self.binary:
            check = 0
            for byte in body:
                check ^= byte
            frame = b"\2\2\2\2" + struct.pack(">I", len(body)) + body + bytes([check])
        else:
            frame = b"\2" + body + b"\3"
        self.sock.sendall(frame)

    def next(self):
        while True:
            body = self.cut()
            if body is not None:
                return body
            chunk = self.sock.recv(65536)
            if not chunk:
                fail("the connection was closed")
            self.buffer += chunk

    def cut(self):
        data = self.buffer
        if self.binary:
            if len(data) < 9:
                return None
            if data[:4] != b"\2\2\2\2":
                fail(f"no start mark: {data[:16]!r}")
            (length,) = struct.unpack(">I", data[4:8])
            if len(data) < length + 9:
                return None
            body, check = data[8 : 8 + length], 0
            for byte in body:
                check ^= byte
            if check != data[8 + length]:
                fail("wrong check byte")
            self.buffer = data[length + 9 :]
            return body
        if not data:
            return None
        if data[:1] != b"\2":
            fail(f"no start mark: {data[:16]!r}")
        end = data.find(b"\3")
        if end < 0:
            return None
        self.buffer = data[end + 1 :]
        return data[1:end]

    def reply(self):
        """The next telegram that is no event; events are kept."""
        while True:
            body = self.next()
            if not body.startswith(b"sSN "):
                return body
            self.waiting.append(body)

    def event(self):
        return self.waiting.pop(0) if self.waiting else self.next()


def packed(dialect, fields):
    """Parameters of a request: (format, value); format as in struct, or s for a string."""
    out = b""
    for kind, value in fields:
        if dialect == "b":
            out += struct.pack(">" + kind, value)
        elif isinstance(value, int):
            bits = {"b": 8, "h": 16, "i": 32}.get(kind)
            out += b" %X" % (value % (1 << bits) if bits else value)
    return out


class Reader:
    """Values of a telegram, one after the other, in either dialect."""

    def __init__(self, dialect, body, head):
        if not body.startswith(head):
            fail(f"{head!r} was due, not {body[:60]!r}")
        self.dialect, self.rest = dialect, body[len(head) :]
        if dialect == "b":
            if self.rest[:1] != b" ":
                fail(f"no blank after the name: {body[:60]!r}")
            self.rest = self.rest[1:]

    def token(self):
        if self.rest[:1] != b" ":
            fail(f"a blank was due: {self.rest[:20]!r}")
        token, blank, rest = self.rest[1:].partition(b" ")
        self.rest = blank + rest
        if token.upper() != token or (len(token) > 1 and token[:1] == b"0" and len(token) != 8):
            fail(f"{token!r} is not as the device writes it")
        return int(token, 16)

    def number(self, kind):
        size = struct.calcsize(">" + kind)
        if self.dialect == "b":
            (value,) = struct.unpack(">" + kind, self.rest[:size])
            self.rest = self.rest[size:]
            return value
        raw = self.token().to_bytes(size, "big")
        return struct.unpack(">" + kind, raw)[0]

    def chars(self, count):
        if self.dialect == "a" and count:
            if self.rest[:1] != b" ":
                fail("a blank was due before a string")
            self.rest = self.rest[1:]
        text, self.rest = self.rest[:count], self.rest[count:]
        return text.decode("latin-1")

    def string(self):
        return self.chars(self.number("H"))

    def end(self):
        if self.rest:
            fail(f"{len(self.rest)} bytes too many: {self.rest[:40]!r}")


def decode_scan(dialect, body):
    """LMDscandata, every field in order."""
    r = Reader(dialect, body, b"sSN LMDscandata")
    s = {"version": r.number("H"), "device": r.number("H"), "serial": r.number("I")}
    s["status"] = (r.number("B"), r.number("B"))
    s["telegram"], s["scan"] = r.number("H"), r.number("H")
    s["scan_us"], s["transmit_us"] = r.number("I"), r.number("I")
    s["inputs"] = (r.number("B"), r.number("B"))
    s["outputs"] = (r.number("B"), r.number("B"))
    s["layer"] = r.number("H")
    s["frequency"], s["shots"] = r.number("I"), r.number("I")
    s["encoders"] = [(r.number("I"), r.number("H")) for _ in range(r.number("H"))]
    s["channels"] = {}
    for kind in ("H", "B"):
        for _ in range(r.number("H")):
            name = r.chars(5)
            scale, offset = r.number("f"), r.number("f")
            start, step, count = r.number("i"), r.number("H"), r.number("H")
            if dialect == "b":
                size = struct.calcsize(kind) * count
                values = struct.unpack(f">{count}{kind}", r.rest[:size])
                r.rest = r.rest[size:]
            else:
                values = tuple(r.number(kind) for _ in range(count))
            s["channels"][name] = (scale, offset, start, step, values)
    s["position"] = [r.number("f") for _ in range(6)] + [r.number("B")] if r.number("H") else None
    s["name"] = r.string() if r.number("H") else ""
    s["comment"] = r.string() if r.number("H") else ""
    s["time"] = [r.number(k) for k in "HBBBBBI"] if r.number("H") else None
    s["events"] = r.number("H")
    r.end()
    return s


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("address")
    parser.add_argument("--dialect", choices=["a", "b"], default="b")
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--beams", type=int, default=761)
    args = parser.parse_args()
    host, port = args.address.rsplit(":", 1)
    sock = socket.create_connection((host, int(port)), timeout=20)
    d = args.dialect
    t = Telegrams(sock, d == "b")

    def ask(verb, name, fields=()):
        t.send(verb + b" " + name + packed(d, fields) if d == "a" or not fields
               else verb + b" " + name + b" " + packed(d, fields))
        answer = {b"sRN": b"sRA", b"sWN": b"sWA", b"sMN": b"sAN", b"sEN": b"sEA"}[verb]
        return Reader(d, t.reply(), answer + b" " + name)

    def done(verb, name, fields=(), status=None):
        r = ask(verb, name, fields)
        if status is not None and (got := r.number("B")) != status:
            fail(f"{name!r}: status {got}, not {status}")
        r.end()

    # Without login nothing may be written; the code is 10.
    t.send(b"sWN EIHstCola" + (b" \1" if d == "b" else b" 1"))
    refusal = t.reply()
    if refusal != (b"sFA\0\x0a" if d == "b" else b"sFA A"):
        fail(f"a write without login was answered {refusal!r}")
    done(b"sMN", b"SetAccessMode", [("b", 3), ("I", 0xDEADBEEF)], 0)

    # The driver's chain, in its order.
    login = [("b", 3), ("I", 0xF4724744)]
    done(b"sMN", b"SetAccessMode", login, 1)
    done(b"sWN", b"EIHstCola", [("B", int(d == "b"))])
    r = ask(b"sRN", b"FirmwareVersion")
    if not r.string().startswith("V"):
        fail("no firmware version")
    r.end()
    r = ask(b"sRN", b"SCdevicestate")
    if r.number("B") != 0:
        fail("a device that somebody is logged in to is busy")
    r.end()
    for name in (b"ODoprh", b"ODpwrc"):
        r = ask(b"sRN", name)
        r.number("I")
        r.end()
    r = ask(b"sRN", b"LocationName")
    location = r.string()
    r.end()
    r = ask(b"sRN", b"DeviceIdent")
    if "LMS5" not in r.string():
        fail("not an LMS5xx")
    r.string()
    r.end()

    def output_range():
        r = ask(b"sRN", b"LMPoutputRange")
        value = (r.number("h"), r.number("I"), r.number("i"), r.number("i"))
        r.end()
        return value

    _, resolution, start, stop = output_range()
    if (start, stop) != (-50000, 1850000):
        fail(f"the output range begins as {start} to {stop}")
    wanted = [("h", 1), ("I", resolution), ("i", start), ("i", stop)]
    done(b"sWN", b"LMPoutputRange", wanted)
    if output_range() != (1, resolution, start, stop):
        fail("the output range does not read back")
    for number in range(30):
        r = ask(b"sRN", b"field%03d" % number)
        if r.number("B") != 0:
            fail("no field is defined")
        r.end()
    r = ask(b"sRN", b"LIDinputstate")
    r.number("H"), r.number("I"), [r.number("B") for _ in range(4)]
    if r.number("H") != 1 or [r.number(k) for k in "HBBBBBI"][0] < 1970:
        fail("no time in LIDinputstate")
    r.end()
    data = [1, 0, 1, 0, 0, 0, 0, 0, 1, 0, 1, 1]
    kinds = "BBBBBBBBBBBH"
    done(b"sWN", b"LMDscandatacfg", list(zip(kinds, data)))
    r = ask(b"sRN", b"LMDscandatacfg")
    if [r.number(k) for k in kinds] != data:
        fail("LMDscandatacfg does not read back")
    r.end()
    # A pair that does not go together, then one that does.
    scan = [("I", 3500), ("h", 1), ("I", 1667), ("i", -50000), ("i", 1850000)]
    r = ask(b"sMN", b"mLMPsetscancfg", scan)
    if r.number("B") == 0:
        fail("35 Hz with 1/6 deg was taken")
    r = ask(b"sRN", b"LMPscancfg")
    now = [r.number(k) for k in "IhIii"]
    r.end()
    r = ask(b"sMN", b"mLMPsetscancfg", list(zip("IhIii", now)))
    if r.number("B") != 0 or [r.number(k) for k in "IhIii"] != now:
        fail("the scanner's own mode was refused")
    r.end()
    done(b"sWN", b"FREchoFilter", [("B", 0)])
    done(b"sMN", b"LMCstartmeas", (), 0)
    done(b"sMN", b"Run", (), 1)
    deadline = time.monotonic() + 60
    while True:
        r = ask(b"sRN", b"STlms")
        state = r.number("H")
        r.number("B")
        clock, date = r.string(), r.string()
        if len(clock) != 8 or clock[2] != ":" or date[2] != ".":
            fail(f"STlms: {clock!r} {date!r}")
        if state == 7:
            break
        if time.monotonic() > deadline:
            fail(f"state {state} for a minute")
        time.sleep(0.2)
    r = ask(b"sRN", b"SCdevicestate")
    if r.number("B") != 1:
        fail("after Run nobody is logged in, and the device is ready")
    done(b"sEN", b"LMDscandata", [("B", 1)], 1)
    done(b"sEN", b"LFErec", [("B", 1)], 1)
    done(b"sEN", b"LIDoutputstate", [("B", 1)], 1)
    done(b"sEN", b"LIDinputstate", [("B", 1)], 1)

    outputs, scans, begun = 0, [], time.monotonic()
    while time.monotonic() - begun < args.seconds or len(scans) < 3:
        event = t.event()
        if event.startswith(b"sSN LIDoutputstate"):
            outputs += 1
        else:
            scans.append(decode_scan(d, event))
    done(b"sEN", b"LMDscandata", [("B", 0)], 0)
    if outputs != 2:
        fail(f"{outputs} LIDoutputstate events")
    for before, after in zip(scans, scans[1:]):
        for counter in ("telegram", "scan"):
            if (after[counter] - before[counter]) % 65536 != 1:
                fail(f"{counter} counter: {before[counter]}, {after[counter]}")
        period_us = (after["scan_us"] - before["scan_us"]) % (1 << 32)
        due_us = 1e8 / after["frequency"]
        if abs(period_us - due_us) > 0.02 * due_us:
            fail(f"{period_us} us from scan to scan at {after['frequency']} / 100 Hz")
    for scan in scans:
        if list(scan["channels"]) != ["DIST1", "RSSI1"] or scan["name"] != location:
            fail(f"channels {list(scan['channels'])}, name {scan['name']!r}")
        scale, offset, start, step, ranges = scan["channels"]["DIST1"]
        if (scale, offset, start, len(ranges)) != (1.0, 0.0, -50000, args.beams):
            fail(f"scale {scale}, offset {offset}, start {start}, {len(ranges)} beams")
        shots = scan["frequency"] * 3600000 / step / 1e4
        if abs(shots - scan["shots"]) > 2 or not math.isclose(step, 1900000 / (args.beams - 1), abs_tol=0.5):
            fail(f"step {step}, {scan['shots']} shots")
        if sum(1 for value in ranges if 200 < value < 20000) < args.beams // 2:
            fail("hardly a range in the frame")
        year = scan["time"][0]
        if scan["time"][6] % 1000 or not 1970 <= year < 2100:
            fail(f"calendar {scan['time']}")
        if not 0 < (scan["transmit_us"] - scan["scan_us"]) % (1 << 32) < 20_000_000:
            fail("transmitted before it was made")
    print(f"CoLa {d.upper()}: every reply as due, {len(scans)} scans of {args.beams} beams")


if __name__ == "__main__":
    main()
