"""hokuyo-sim's USB/IP front as a kernel's client would use it: list, import, descriptors, line coding, bulk both ways, unlink.

usage: usbip_test.py HOKUYO_SIM
"""
import collections
import errno
import signal
import socket
import struct
import subprocess
import sys

HOKUYO_SIM = sys.argv[1]
LIMIT_S = 60
BULK_IN, BULK_OUT, INTERRUPT_IN = 1, 2, 3
Device = collections.namedtuple("Device", "busid bus address speed vendor product")
Reply = collections.namedtuple("Reply", "command seqnum status length data")


class Client:
    def __init__(self, port):
        self.line = socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S)
        self.seqnum = 0
        self.device = None
        self.reading = set()  # sequence numbers of transfers to the host

    def take(self, count):
        data = b""
        while len(data) < count:
            more = self.line.recv(count - len(data))
            assert more, "closed in the middle of a message"
            data += more
        return data

    def ended(self):
        try:
            return self.line.recv(1) == b""
        except ConnectionResetError:
            return True

    def take_device(self):
        _, busid, bus, address, speed, vendor, product = struct.unpack(">256s32s3IHH", self.take(304))
        self.take(8)
        return Device(busid.rstrip(b"\0").decode(), bus, address, speed, vendor, product)

    def devices(self):
        self.line.sendall(struct.pack(">HHI", 0x0111, 0x8005, 0))
        version, code, status, count = struct.unpack(">HHII", self.take(12))
        assert (version, code, status) == (0x0111, 0x0005, 0)
        found = []
        for _ in range(count):
            found.append((self.take_device(), [self.take(4)[:3] for _ in range(2)]))
        return found

    def ask_for(self, busid):
        """The device, or None if the import is refused."""
        self.line.sendall(struct.pack(">HHI32s", 0x0111, 0x8003, 0, busid.encode()))
        version, code, status = struct.unpack(">HHI", self.take(8))
        assert (version, code) == (0x0111, 0x0003)
        self.device = self.take_device() if status == 0 else None
        return self.device

    def submit(self, endpoint, into, length, setup=bytes(8), data=b""):
        self.seqnum += 1
        if into:
            self.reading.add(self.seqnum)
        devid = self.device.bus << 16 | self.device.address
        self.line.sendall(struct.pack(">10I8s", 1, self.seqnum, devid, into, endpoint, 0, length, 0, 0, 0, setup) + data)
        return self.seqnum

    def unlink(self, seqnum):
        self.seqnum += 1
        devid = self.device.bus << 16 | self.device.address
        self.line.sendall(struct.pack(">6I24x", 2, self.seqnum, devid, 0, 0, seqnum))
        return self.seqnum

    def reply(self):
        command, seqnum, *_, status, length = struct.unpack(">5IiI20x", self.take(48))
        data = self.take(length) if command == 3 and seqnum in self.reading else b""
        return Reply(command, seqnum, status, length, data)

    def control(self, request_type, request, value, length, data=b""):
        setup = struct.pack("<BBHHH", request_type, request, value, 0, length)
        seqnum = self.submit(0, int(request_type >= 0x80), length, setup, data)
        reply = self.reply()
        assert reply.seqnum == seqnum and reply.command == 3, reply
        return reply

    def write(self, text):
        seqnum = self.submit(BULK_OUT, 0, len(text), data=text)
        reply = self.reply()
        assert (reply.seqnum, reply.status, reply.length) == (seqnum, 0, len(text)), reply

    def read_until(self, enough):
        """Bulk IN, one transfer after the other."""
        heard = b""
        while not enough(heard):
            seqnum = self.submit(BULK_IN, 1, 4096)
            reply = self.reply()
            assert (reply.seqnum, reply.status) == (seqnum, 0), reply
            heard += reply.data
        return heard


def good_sum(line):
    return sum(line[:-1]) % 64 + 0x30 == line[-1]


def a_scanner_is_listed_and_imported_once(port):
    client = Client(port)
    (device, interfaces), (other, _) = client.devices()
    assert device == Device("1-1", 1, 2, 2, 0x15D1, 0x0000), device
    assert other.busid == "1-2", other
    assert interfaces == [bytes((2, 2, 1)), bytes((10, 0, 0))], interfaces
    assert client.ask_for("7-7") is None
    assert client.ask_for("1-1") == device
    rival = Client(port)
    assert [d.busid for d, _ in rival.devices()] == ["1-2"]
    assert rival.ask_for("1-1") is None
    return client


def it_enumerates_as_a_serial_line(client):
    device = client.control(0x80, 6, 0x0100, 18)
    assert len(device.data) == 18 and device.data[8:12] == b"\xd1\x15\0\0", device
    total = struct.unpack("<H", client.control(0x80, 6, 0x0200, 9).data[2:4])[0]
    config = client.control(0x80, 6, 0x0200, total).data
    assert len(config) == total
    endpoints = []
    while config:
        if config[1] == 5:
            endpoints.append(config[2])
        config = config[config[0]:]
    assert sorted(endpoints) == [BULK_OUT, 0x80 | BULK_IN, 0x80 | INTERRUPT_IN], endpoints
    assert client.control(0x80, 6, 0x0302, 255).data[2:].decode("utf-16le") == "URG-Series USB Driver"
    assert client.control(0x00, 9, 1, 0).status == 0  # SET_CONFIGURATION
    coding = struct.pack("<IBBB", 115200, 0, 0, 8)
    assert client.control(0x21, 0x20, 0, len(coding), coding).status == 0
    assert client.control(0xA1, 0x21, 0, 7).data == coding
    assert client.control(0x21, 0x22, 3, 0).status == 0
    assert client.control(0xC0, 0x99, 0, 4).status == -errno.EPIPE


def it_speaks_scip(client):
    client.write(b"VV\n")
    version = client.read_until(lambda heard: heard.endswith(b"\n\n"))
    assert b"SERI:00900001;" in version, version
    client.write(b"MD0000108001001\n")
    heard = client.read_until(lambda heard: heard.count(b"\n\n") == 2)
    echo, status, stamp, *lines = heard.split(b"\n\n")[1].split(b"\n")
    assert echo == b"MD0000108001000" and status == b"99b", (echo, status)
    assert all(good_sum(line) for line in [status, stamp, *lines])
    assert sum(len(line) - 1 for line in lines) == 3 * 1081


def a_pending_read_can_be_taken_back(client):
    client.write(b"QT\n")
    client.read_until(lambda heard: heard.endswith(b"QT\n00P\n\n"))
    pending = client.submit(BULK_IN, 1, 4096)
    unlinked = client.unlink(pending)
    reply = client.reply()
    assert (reply.command, reply.seqnum, reply.status) == (4, unlinked, -errno.ECONNRESET), reply
    again = client.unlink(pending)
    reply = client.reply()
    assert (reply.command, reply.seqnum, reply.status) == (4, again, 0), reply


def a_client_that_leaves_leaves_the_scanner_free(client, port):
    client.line.close()
    follower = Client(port)
    while follower.ask_for("1-1") is None:  # the server hears of the end when it looks next
        pass
    follower.write(b"VV\n")
    assert b"SERI:" in follower.read_until(lambda heard: heard.endswith(b"\n\n"))
    follower.line.close()


def a_pulled_cable_ends_the_connection(port):
    client = Client(port)
    assert client.ask_for("1-2")
    client.write(b"MD0000108001000\n")
    try:
        client.read_until(lambda heard: False)
    except (AssertionError, ConnectionError):
        pass
    follower = Client(port)
    while follower.ask_for("1-2") is None:  # away for 0.2 s
        pass


def nonsense_costs_one_connection(port):
    for bytes_ in (b"GET / HTTP/1.1\r\n\r\n", struct.pack(">HHI", 0x0111, 0x8077, 0), b"\xff" * 4096):
        client = Client(port)
        client.line.sendall(bytes_)
        assert client.ended()
    client = Client(port)
    assert client.ask_for("1-1")
    client.submit(BULK_IN, 1, 0x7FFFFFFF)
    assert client.ended()


sim = subprocess.Popen([HOKUYO_SIM, "--front", "usbip", "--usbip-port", "0", "--boot", "0", "--scanners", "2", "--fault",
                        "2:unplug@0.2:0.2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
try:
    free_port = int(sim.stdout.readline().rsplit(":", 1)[1])
    first = a_scanner_is_listed_and_imported_once(free_port)
    it_enumerates_as_a_serial_line(first)
    it_speaks_scip(first)
    a_pending_read_can_be_taken_back(first)
    a_client_that_leaves_leaves_the_scanner_free(first, free_port)
    a_pulled_cable_ends_the_connection(free_port)
    nonsense_costs_one_connection(free_port)
finally:
    sim.send_signal(signal.SIGTERM)
    said = sim.communicate(timeout=LIMIT_S)[1]
assert sim.returncode == 0, (sim.returncode, said)
assert said.count("its connection is closed") == 4 and "(4 so far)" in said, said
