"""Makes what the VM boots: a clean Debian 12 with a kernel, into which apt installs our packages and what they depend on.

usage: make_root.py PACKAGES_FOLDER FOLDER   makes FOLDER/root.folder and prints its path.

Needs root, mmdebstrap and Debian's mirror. What it is before our packages come is kept in FOLDER/base-*.tar and used again.
"""
import hashlib
import pathlib
import shutil
import subprocess
import sys

INCLUDE = "systemd,systemd-sysv,udev,dbus,kmod,iproute2,usbip,linux-image-amd64,initramfs-tools"
# Of the kernel's modules only what the VM has: a tenth of them, and the initial ramdisk is made in seconds.
EXCLUDE = ["/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/lib/modules/*/kernel/drivers/*",
           "/lib/modules/*/kernel/sound/*", "/lib/modules/*/kernel/fs/*",
           "/lib/modules/*/kernel/net/*"]
KEEP = ["drivers/usb/*", "drivers/virtio/*", "drivers/block/virtio_blk*", "drivers/net/virtio_net*",
        "drivers/net/net_failover*", "net/core/*", "fs/autofs/*", "fs/ext4/*", "fs/jbd2/*", "fs/mbcache*"]
RAMDISK = "virtio_pci virtio_blk ext4 crc32c_generic"


def make_base(base):
    options = [f"--dpkgopt=path-exclude={path}" for path in EXCLUDE]
    options += [f"--dpkgopt=path-include=/lib/modules/*/kernel/{path}" for path in KEEP]
    hook = ('mkdir -p "$1/etc/initramfs-tools/conf.d"; echo MODULES=list >"$1/etc/initramfs-tools/conf.d/vm"; '
            f'printf "%s\\n" {RAMDISK} >"$1/etc/initramfs-tools/modules"')
    subprocess.run(["mmdebstrap", "--quiet", "--variant=minbase", f"--include={INCLUDE}", *options, f"--essential-hook={hook}",
                    "bookworm", base], check=True)


def install(base, packages, root):
    """As on a cart: apt finds the dependencies. Scripts run, no service is started."""
    names = [path.name for path in packages]
    with_ours = root.with_suffix(".folder")
    shutil.rmtree(with_ours, ignore_errors=True)
    with_ours.mkdir()
    subprocess.run(["tar", "-C", with_ours, "-xf", base], check=True)
    for path in packages:
        shutil.copy(path, with_ours / "tmp")
    # Names of mirrors are found where the machine finds them.
    shutil.copy("/etc/resolv.conf", with_ours / "etc/resolv.conf")
    for words in (["apt-get", "update", "-q"],
                  ["apt-get", "install", "-q", "--yes", "--no-install-recommends", *[f"/tmp/{name}" for name in names]],
                  ["apt-get", "clean"]):
        done = subprocess.run(["chroot", with_ours, "env", "DEBIAN_FRONTEND=noninteractive", *words], capture_output=True,
                              text=True)
        if done.returncode != 0:
            sys.exit(f"{' '.join(words)} failed in the clean root:\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}")
    return with_ours


def main():
    packages = [path for path in sorted(pathlib.Path(sys.argv[1]).glob("*.deb")) if "java" not in path.name]
    folder = pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    base = folder / f"base-{hashlib.sha256(pathlib.Path(__file__).read_bytes()).hexdigest()[:12]}.tar"
    if not base.exists():
        part = folder / "part.tar"
        make_base(part)
        part.rename(base)
    print(install(base, packages, folder / "root"))


if __name__ == "__main__":
    main()
