#!/usr/bin/env python3
"""Writes packed seed inputs for fuzz_carmen into the folder given; the text ones lie in fuzz_carmen/."""
import gzip
import lzma
import pathlib
import sys

LINE = b"FLASER 3 1.07 81.91 0.001 0 0 0 1.5 -2.5 0.25 1.0 host 1.0\n"

folder = pathlib.Path(sys.argv[1])
(folder / "gzip").write_bytes(gzip.compress(LINE, mtime=0))
(folder / "gzip_cut").write_bytes(gzip.compress(LINE, mtime=0) + gzip.compress(LINE, mtime=0)[:-4])
(folder / "xz").write_bytes(lzma.compress(LINE) + lzma.compress(LINE))
