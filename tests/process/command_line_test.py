"""Man pages and bash completion say what the programs' --help says.

usage: command_line_test.py SUBMAPCTL SUBMAPD SOURCE_FOLDER TOML_PAGE
"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

SUBMAPCTL, SUBMAPD = sys.argv[1:3]
SOURCE = pathlib.Path(sys.argv[3])
TOML_PAGE = pathlib.Path(sys.argv[4])
LIMIT_S = 60


def help_of(*command):
    done = subprocess.run([*command, "--help"], capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 0, done
    return done.stdout


def verbs():
    found = re.findall(r"^  ([a-z][a-z-]*)", help_of(SUBMAPCTL).split("\nSubcommands:\n", 1)[1], re.MULTILINE)
    assert len(found) > 10, found
    return found


def options(*command):
    return re.findall(r"^  (?:-\w,)?(--[a-z-]+)", help_of(*command), re.MULTILINE)


def plain(page):
    """The text of a page without roff's escapes and requests for fonts."""
    text = page.read_text(encoding="utf-8").replace("\\-", "-").replace("\\&", "")
    return re.sub(r'^\.(B|BR|BI|IR|RB|RI|I)\s+', "", text, flags=re.MULTILINE)


def sections(text):
    """Section of each command: { "save-map": "..." }"""
    parts = re.split(r"^\.SS ([a-z-]+)", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], (part.split("\n.SH ")[0] for part in parts[2::2])))


def each_command_has_its_section():
    text = plain(SOURCE / "tools/submapctl/submapctl.1")
    documented = sections(text)
    asking = text.split(".SH ASKING THE DAEMON")[1].split("\n.SS")[0]
    assert set(documented) == set(verbs()), set(documented) ^ set(verbs())
    for verb in verbs():
        offered = set(options(SUBMAPCTL, verb)) - {"--help"}
        told = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", documented[verb]))
        if "--socket" in offered:
            told |= set(re.findall(r"--[a-z]+", asking))
        assert offered <= told and told - {"--help"} <= offered, (verb, offered ^ told)


def the_daemons_options_are_documented():
    text = plain(SOURCE / "daemon/man/submapd.8").split(".SH OPTIONS")[1].split(".SH ")[0]
    assert set(re.findall(r"--[a-z]+", text)) == set(options(SUBMAPD))


def each_key_is_documented():
    keys = re.search(r"```toml\n(.*?)```", (SOURCE / "daemon/configuration.md").read_text(encoding="utf-8"), re.DOTALL)
    expected = re.findall(r"^(\w+) = (.*)$", keys.group(1), re.MULTILINE)
    assert len(expected) > 40
    text = TOML_PAGE.read_text(encoding="utf-8")
    found = re.findall(r'^\.BR (\S+) " \(default (.*)\)"$', text, re.MULTILINE)
    assert [(k, v.replace("\\(dq", '"').replace("\\-", "-")) for k, v in found] == expected, found


def pages_are_good_roff():
    pages = [SOURCE / "tools/submapctl/submapctl.1", SOURCE / "daemon/man/submapd.8", TOML_PAGE]
    try:
        done = subprocess.run(["groff", "-man", "-Tutf8", "-ww", "-z", *pages], capture_output=True, text=True, timeout=LIMIT_S)
    except FileNotFoundError:
        print("There is no groff here: the pages are not rendered.", file=sys.stderr)
        return
    assert done.returncode == 0 and not done.stderr, done.stderr


def complete(*words):
    """What bash offers with the cursor at the end of these words."""
    script = (f'. {SOURCE}/tools/submapctl/submapctl.bash; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _submapctl; '
              'printf "%s\\n" "${COMPREPLY[@]}"')
    environment = dict(os.environ, PATH=f"{pathlib.Path(SUBMAPCTL).parent}:{os.environ['PATH']}")
    done = subprocess.run(["bash", "-c", script, "bash", "submapctl", *words], capture_output=True, text=True,
                          timeout=LIMIT_S, env=environment)
    assert done.returncode == 0 and not done.stderr, done
    return done.stdout.split()


def bash_completes_what_there_is():
    assert complete("") == [*verbs(), "--help"]
    assert complete("sa") == ["save-map"]
    for verb in verbs():
        assert sorted(complete(verb, "--")) == sorted(options(SUBMAPCTL, verb)), verb
    assert complete("replay", "--filter", "") == ["adaptive", "rbpf", "fastslam"]
    assert complete("replay", "x.clf", "--odometry", "i") == ["ignore"]
    assert complete("replay", "--seed", "") == []
    assert complete("save-map", "--wait", "--f") == ["--force"]
    assert complete("pause", "") == []
    with tempfile.TemporaryDirectory() as folder:
        log = pathlib.Path(folder) / "drive.clf"
        log.touch()
        assert complete("replay", f"{folder}/dr") == [str(log)]
        assert complete("replay", "--config", f"{folder}/") == [str(log)]


each_command_has_its_section()
the_daemons_options_are_documented()
each_key_is_documented()
pages_are_good_roff()
bash_completes_what_there_is()
