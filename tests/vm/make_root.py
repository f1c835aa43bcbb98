"""Makes what the VM boots: a clean Debian 12 with a kernel and what our packages depend on, into which dpkg installs them.

usage: make_root.py PACKAGES_FOLDER FOLDER   makes FOLDER/root and prints its path.

Needs root and mmdebstrap. The Debian comes from the mirror once; FOLDER/base-*.tar keeps it, and then no network is needed.
"""
import hashlib
import pathlib
import shutil
import subprocess
import sys

INCLUDE = "systemd,systemd-sysv,udev,dbus,kmod,usbip,linux-image-amd64,initramfs-tools"
# Of the kernel's modules only what the VM has: a tenth of them, and the initial ramdisk is made in seconds.
EXCLUDE = ["/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/lib/modules/*/kernel/drivers/*",
           "/lib/modules/*/kernel/sound/*", "/lib/modules/*/kernel/fs/*",
           "/lib/modules/*/kernel/net/*"]
KEEP = ["drivers/usb/*", "drivers/virtio/*", "drivers/block/virtio_blk*", "drivers/net/virtio_net*",
        "drivers/net/net_failover*", "net/core/*", "fs/autofs/*", "fs/ext4/*", "fs/jbd2/*", "fs/mbcache*"]
RAMDISK = "virtio_pci virtio_blk ext4 crc32c_generic"


def dependencies(packages):
    """Names of what the packages say they need; of alternatives the first."""
    names = set()
    for package in packages:
        depends = subprocess.run(["dpkg-deb", "--field", package, "Depends"], check=True, capture_output=True, text=True)
        names |= {one.split("|")[0].split("(")[0].strip() for one in depends.stdout.split(",")}
    return sorted(names)


def make_base(base, needed):
    options = [f"--dpkgopt=path-exclude={path}" for path in EXCLUDE]
    options += [f"--dpkgopt=path-include=/lib/modules/*/kernel/{path}" for path in KEEP]
    hook = ('mkdir -p "$1/etc/initramfs-tools/conf.d"; echo MODULES=list >"$1/etc/initramfs-tools/conf.d/vm"; '
            f'printf "%s\\n" {RAMDISK} >"$1/etc/initramfs-tools/modules"')
    include = ",".join([INCLUDE, *needed])
    subprocess.run(["mmdebstrap", "--quiet", "--variant=minbase", f"--include={include}", *options, f"--essential-hook={hook}",
                    "bookworm", base], check=True)


def install(base, packages, root):
    """As on a cart, but that no service is started: nothing runs in a folder. What Depends leaves out is missing."""
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir()
    subprocess.run(["tar", "-C", root, "-xf", base], check=True)
    for path in packages:
        shutil.copy(path, root / "tmp")
    done = subprocess.run(["chroot", root, "dpkg", "--install", *[f"/tmp/{path.name}" for path in packages]],
                          capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"the packages cannot be installed in the clean root:\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}")


def main():
    packages = [path for path in sorted(pathlib.Path(sys.argv[1]).glob("*.deb")) if "java" not in path.name]
    folder = pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    needed = dependencies(packages)
    made_of = pathlib.Path(__file__).read_bytes() + " ".join(needed).encode()
    base = folder / f"base-{hashlib.sha256(made_of).hexdigest()[:12]}.tar"
    if not base.exists():
        for old in folder.glob("base-*.tar"):
            old.unlink()
        part = folder / "part.tar"
        make_base(part, needed)
        part.rename(base)
    install(base, packages, folder / "root")
    print(folder / "root")


if __name__ == "__main__":
    main()
