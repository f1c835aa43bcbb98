#!/usr/bin/env python3
"""submapctl scip-decode as others script against it. Usage: scip_decode_test.py SUBMAPCTL"""
import json
import subprocess
import sys
import unittest

SUBMAPCTL = sys.argv.pop(1)


def line(text: bytes) -> bytes:
    return text + bytes([sum(text) % 64 + 0x30]) + b"\n"


def reply(echo: bytes, status: bytes, *body: bytes) -> bytes:
    return echo + b"\n" + line(status) + b"".join(line(text) for text in body) + b"\n"


def decode(rx: bytes, *sent: str):
    options = [option for command in sent for option in ("--tx", command)]
    return subprocess.run([SUBMAPCTL, "scip-decode", *options], input=rx, capture_output=True, check=False, timeout=60)


class ScipDecodeTest(unittest.TestCase):
    def events(self, rx, *sent):
        result = decode(rx, *sent)
        self.assertEqual(result.returncode, 0, result.stderr)
        return [json.loads(text) for text in result.stdout.decode("ascii").splitlines()]

    def test_each_event_is_a_line(self):
        md = b"MD0540054101000"
        rx = reply(md, b"00") + reply(md, b"99", b"BI9Y", b"00]0Kd") + reply(b"QT", b"00") + b"xx"
        self.assertEqual(self.events(rx, md.decode(), "QT"), [
            {"ev": "ack", "echo": "MD0540054101000"},
            {"ev": "scan", "echo": "MD0540054101000", "t": 4821609, "remaining": 0, "ranges": [45, 1780]},
            {"ev": "reply", "echo": "QT", "status": "00"},
            {"ev": "fault", "class": "truncated", "where": "end", "line": 0}])

    def test_parameters_are_an_object(self):
        rx = b"VV\n00P\nPROT:SCIP 2.0;N\n\n"
        self.assertEqual(self.events(rx, "VV"), [{"ev": "reply", "echo": "VV", "status": "00", "params": {"PROT": "SCIP 2.0"}}])

    def test_nothing_is_expected_that_was_not_sent(self):
        self.assertEqual([event["class"] for event in self.events(b"VV\n00P\n\n")], ["bad_echo"])
        self.assertEqual(self.events(b""), [])

    def test_more_commands_than_may_be_unanswered(self):
        rx = b"".join(reply(b"TM1;%d" % i, b"00", b"0000") for i in range(300))
        events = self.events(rx, *(f"TM1;{i}" for i in range(300)))
        self.assertEqual([event["echo"] for event in events], [f"TM1;{i}" for i in range(300)])

    def test_commands_that_are_none_are_refused_with_words(self):
        for text in ("", "V\tV", "x" * 100, "MD0000999901000"):
            result = decode(b"", text)
            self.assertEqual(result.returncode, 2, text)
            self.assertIn(b"--tx", result.stderr)


if __name__ == "__main__":
    unittest.main()
