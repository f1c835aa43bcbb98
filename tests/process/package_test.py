"""Builds the Debian packages and looks into them. usage: package_test.py BUILD_FOLDER"""
import pathlib
import re
import subprocess
import sys
import tempfile
import zipfile

BUILD = pathlib.Path(sys.argv[1])
PACKAGES = BUILD / "packages"
TYPES = pathlib.Path(__file__).resolve().parents[2] / "proto/lcm"


def run(*words):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, (done.args, done.stdout[-2000:], done.stderr[-2000:])
    return done.stdout


def field(package, name):
    return run("dpkg-deb", "-f", package, name).strip()


def files(package):
    return {line.split(None, 5)[5][1:]: line.split(None, 5)[:2] for line in run("dpkg-deb", "-c", package).splitlines()
            if not line.endswith("/")}


def one(pattern):
    found = list(PACKAGES.glob(pattern))
    assert len(found) == 1, found
    return found[0]


def the_daemon_has_all_it_needs():
    package = one("submapd_*.deb")
    wanted = {"/usr/sbin/submapd", "/etc/submapd/submapd.toml", "/usr/lib/systemd/system/submapd.service",
              "/usr/lib/systemd/system/submapd-lcm-route.service", "/usr/lib/udev/rules.d/60-hokuyo.rules",
              "/usr/lib/sysusers.d/submapd.conf", "/usr/lib/tmpfiles.d/submapd.conf", "/usr/lib/sysctl.d/60-submapd.conf",
              "/usr/share/man/man8/submapd.8.gz", "/usr/share/man/man5/submapd.toml.5.gz",
              "/usr/share/doc/submapd/copyright", "/usr/share/doc/submapd/changelog.gz"}
    held = files(package)
    assert set(held) == wanted, set(held) ^ wanted
    assert {owner for _, owner in held.values()} == {"root/root"}
    assert run("dpkg-deb", "-I", package, "conffiles").split() == ["/etc/submapd/submapd.toml"]
    needs = field(package, "Depends")
    for library in ("libusb-1.0-0", "liblcm1", "libsystemd0", "libc6", "systemd", "udev", "iproute2"):
        assert re.search(rf"(^|, ){re.escape(library)}( \(|,|$)", needs), (library, needs)
    assert "umockdev" not in needs, "the daemon must not need the emulation"


def the_tools_are_apart():
    held = files(one("submapd-tools_*.deb"))
    for path in ("/usr/bin/submapctl", "/usr/bin/hokuyo-sim", "/usr/bin/submap-spy", "/usr/share/man/man1/submapctl.1.gz",
                 "/usr/share/man/man1/hokuyo-sim.1.gz", "/usr/share/bash-completion/completions/submapctl"):
        assert path in held, held
    assert not [path for path in held if path.startswith("/etc")], held


def java_is_apart():
    packages = list(PACKAGES.glob("libsubmapd-types-java_*_all.deb"))
    if not packages:
        print("There is no package for Java: the build found no JDK or no liblcm-java.", file=sys.stderr)
        return
    held = files(packages[0])
    assert "/usr/share/java/submapd-types.jar" in held, held
    with tempfile.TemporaryDirectory() as folder:
        run("dpkg-deb", "-x", packages[0], folder)
        with zipfile.ZipFile(f"{folder}/usr/share/java/submapd-types.jar") as jar:
            classes = {pathlib.PurePath(name).stem for name in jar.namelist() if name.endswith(".class")}
    types = {path.stem for path in TYPES.glob("*.lcm")}
    assert classes == types and len(types) > 5, classes ^ types


def nothing_of_this_machine_is_inside():
    for package in PACKAGES.glob("*.deb"):
        with tempfile.TemporaryDirectory() as folder:
            run("dpkg-deb", "-x", package, folder)
            for path in pathlib.Path(folder).rglob("*"):
                if path.is_file() and path.read_bytes()[:4] == b"\x7fELF":
                    dynamic = run("readelf", "-d", path)
                    assert "RPATH" not in dynamic and "RUNPATH" not in dynamic, (path, dynamic)
                    assert ".debug_info" not in run("readelf", "-S", path), f"{path} is not stripped"


for old in PACKAGES.glob("*.deb"):
    old.unlink()
run("cpack", "--config", BUILD / "CPackConfig.cmake")
the_daemon_has_all_it_needs()
the_tools_are_apart()
java_is_apart()
nothing_of_this_machine_is_inside()
