"""Writes submapd.toml(5) from daemon/configuration.md, which a unit test keeps in step with the program.

usage: write_toml_page.py CONFIGURATION.MD TEMPLATE PAGE
"""
import pathlib
import re
import sys


def roff(text):
    """Text as roff shows it unchanged."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text.startswith((".", "'")) else text


def keys_as_roff(block):
    lines = []
    about = None
    for line in block.splitlines():
        if not line:
            continue
        if line.startswith("["):
            lines += [".SS " + roff(line)]
        elif line.startswith("# "):
            about = line[2:]
        else:
            name, default = line.split(" = ", 1)
            meaning, allowed = about.rsplit(": ", 1)
            shown = roff(default).replace('"', "\\(dq")
            lines += [".TP", f'.BR {roff(name)} " (default {shown})"', roff(meaning[0].upper() + meaning[1:]) + ":",
                      roff(allowed) + "."]
            about = None
    return "\n".join(lines)


def main():
    page, template, out = map(pathlib.Path, sys.argv[1:4])
    block = re.search(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    if not block:
        sys.exit(f"{page}: no toml block")
    text = template.read_text(encoding="utf-8").replace("@KEYS@", keys_as_roff(block.group(1)))
    out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
