"""ads-push and Beckhoff's own client library (in pyads) on one wire.

server ADDRESS  pyads' test server, a PLC with MAIN.SickValue; prints what it was left with
client TARGET-IP NETID  reads MAIN.SickValue through Beckhoff's library, prints it
frames FILE     the requests of `ads-push --dry-run`, decoded by tshark
"""

import struct
import subprocess
import sys


def show(values):
    print(" ".join(struct.pack("<d", v).hex() for v in values))


def server(address):
    from pyads import testserver
    from pyads.testserver import AdsTestServer, AdvancedHandler, PLCVariable

    name = "MAIN.SickValue"
    handler = AdvancedHandler()
    handler.add_variable(
        PLCVariable(name, bytes(72), ads_type=5, symbol_type="ARRAY [0..8] OF LREAL")
    )
    # Without it the question for the program's version would end the server's thread.
    handler.add_variable(PLCVariable("version", b"\x01", 17, "BYTE", 0xF008, 0))
    served = AdsTestServer(handler=handler, logging=False, ip_address=address)
    served.start()
    print("ready", flush=True)
    sys.stdin.read()
    show(struct.unpack("<9d", handler.get_variable_by_name(name).value))
    served.stop()


def client(address, net_id):
    import pyads

    # The library speaks for this NetId.
    pyads.set_local_address("127.0.0.9.1.1")
    plc = pyads.Connection(net_id, 851, address)
    plc.open()
    try:
        plc.set_timeout(5000)
        values = plc.read_by_name("MAIN.SickValue", pyads.PLCTYPE_LREAL * 9)
        show(values)
        symbol = plc.get_symbol("MAIN.SickValue")
        assert symbol.symbol_type in ("ARRAY [0..8] OF LREAL", "LREAL_9", "LREAL"), symbol.symbol_type
        names = sorted(s.name for s in plc.get_all_symbols())
        assert "MAIN.SickValue" in names, names
    finally:
        plc.close()


def frames(path):
    hexes, current = [], []
    for line in open(path):
        if line.startswith("# pose"):
            if current:
                hexes.append(current)
            current = []
        elif not line.startswith("#"):
            current.append(line.rstrip("\n"))
    hexes.append(current)
    dump = path + ".hex"
    with open(dump, "w") as out:
        for block in hexes:
            out.write("\n".join(block) + "\n\n")
    capture = path + ".pcap"
    subprocess.run(["text2pcap", "-q", "-T", "40000,48898", dump, capture], check=True)
    fields = ["ams.targetport", "ams.cmdid", "ams.invokeid", "ams.ads_indexgroup", "ams.ads_indexoffset", "ams.ads_cblength"]
    arguments = [a for f in fields for a in ("-e", f)]
    decoded = subprocess.run(
        ["tshark", "-r", "-", "-T", "fields", *arguments],
        check=True, capture_output=True, text=True, stdin=open(capture),
    ).stdout.splitlines()
    assert len(decoded) == len(hexes), (len(decoded), len(hexes))
    for block, line in zip(hexes, decoded):
        raw = bytes.fromhex("".join(b.split(" ", 1)[1] for b in block))
        group, offset, length = struct.unpack_from("<III", raw, 38)
        port, command, invoke, *rest = [int(v, 0) for v in line.split("\t")]
        assert (port, command, invoke) == (851, 3, 1), line
        assert rest == [group, offset, length] and length == 72, line
    print(f"tshark reads {len(decoded)} write requests as they were meant")


if __name__ == "__main__":
    {"server": server, "client": client, "frames": frames}[sys.argv[1]](*sys.argv[2:])
