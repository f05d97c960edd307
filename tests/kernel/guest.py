"""A command under Debian's kernel, in QEMU: the guest's / is this machine's own, and nothing is written back.

The guest boots from an initramfs of busybox and modules, mounts / of the host by 9p, read-only, and lays a tmpfs over
it: every program, virtual environment and test file is there under its own name. Without KVM, so that it works in a
container or a virtual machine too; what takes a millisecond outside takes ten inside.
"""

from __future__ import annotations

import gzip
import lzma
import os
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from debian_kernel import SEARCHED, Kernel

ROOT_MODULES = ("virtio_pci", "9pnet_virtio", "9p", "overlay")
EXIT = "\nguest: exit "

INIT = """#!/bin/busybox sh
B=/bin/busybox
$B mkdir -p /proc /sys /dev /lower /upper /root
$B mount -t proc proc /proc; $B mount -t sysfs sys /sys; $B mount -t devtmpfs dev /dev
while read -r m; do $B insmod "/mod/$m" || echo "no module $m"; done < /order
$B mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=loose,ro host /lower || $B poweroff -f
$B mount -t tmpfs -o size=60% tmpfs /upper; $B mkdir /upper/files /upper/work
$B mount -t overlay -o lowerdir=/lower,upperdir=/upper/files,workdir=/upper/work overlay /root
cd /root; $B mkdir -p proc sys dev run
$B mount -t proc proc proc; $B mount -t sysfs sys sys; $B mount -t devtmpfs dev dev; $B mount -t tmpfs tmpfs run
$B mkdir -p dev/pts dev/shm; $B mount -t devpts devpts dev/pts; $B mount -t tmpfs tmpfs dev/shm
$B cp /job run/job
$B stty -F /dev/ttyS1 raw -echo
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root
$B chroot /root /bin/sh /run/job </dev/null >/dev/ttyS1 2>&1
$B printf '\\nguest: exit %d\\n' $? >/dev/ttyS1
$B poweroff -f
"""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command in the guest ended.

    code     its exit code; None where it did not end within the time
    output   what it wrote to stdout and stderr
    console  what the kernel said
    """

    code: int | None
    output: str
    console: str
    seconds: float


def run_in_guest(
    command: Sequence[str | os.PathLike[str]],
    *,
    kernel: Kernel,
    modules: Sequence[str] = (),
    environment: dict[str, str] | None = None,
    qemu: Sequence[str] = (),
    timeout_s: float,
) -> Ended:
    """Boot, load `modules`, run `command` as root, power off.

    qemu  more arguments for QEMU

    Raises RuntimeError where QEMU fails.
    """
    words = [f"{name}={value}" for name, value in (environment or {}).items()]
    job = f"cd {shlex.quote(str(Path.cwd()))}\n{shlex.join(['env', *words, *(os.fspath(word) for word in command)])}\n"
    with tempfile.TemporaryDirectory(prefix="guest-") as name:
        folder = Path(name)
        initramfs = _initramfs(folder, kernel, [*ROOT_MODULES, *modules], job)
        console, output = folder / "console", folder / "output"
        began = time.monotonic()
        process = subprocess.Popen(
            [*_qemu(kernel, initramfs, console, output), *qemu],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            told, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            told = ""
        finally:
            process.kill()
            process.communicate()
        if process.returncode > 0:
            raise RuntimeError(f"QEMU fails: {told.strip()[-500:]}")
        written, end, code = _text(output).rpartition(EXIT)
        return Ended(int(code) if end else None, written if end else code, _text(console), time.monotonic() - began)


def _text(path: Path) -> str:
    return path.read_bytes().decode(errors="replace").replace("\r\n", "\n") if path.exists() else ""


def _qemu(kernel: Kernel, initramfs: Path, console: Path, output: Path) -> list[str]:
    return [
        # One processor: with two, emulated, records vanished now and then between inv_mpu6050, which had read them from
        # the chip, and the reader of /dev/iio:device0. It is not slower.
        *("qemu-system-x86_64", "-M", "q35", "-accel", "tcg,thread=multi", "-cpu", "max", "-m", "1024", "-smp", "1"),
        *("-nodefaults", "-no-reboot", "-display", "none", "-vga", "none"),
        *("-serial", f"file:{console}", "-serial", f"file:{output}"),
        *("-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap"),
        *("-kernel", str(kernel.image), "-initrd", str(initramfs)),
        *("-append", "console=ttyS0 panic=-1 tsc=reliable random.trust_cpu=on"),
    ]


def _initramfs(folder: Path, kernel: Kernel, modules: Sequence[str], job: str) -> Path:
    root = folder / "root"
    (root / "bin").mkdir(parents=True)
    (root / "mod").mkdir()
    shutil.copy(shutil.which("busybox") or "/bin/busybox", root / "bin/busybox")
    names = []
    for file in kernel.files_of(modules):
        data = file.read_bytes()
        if file.suffix == ".xz":  # as from Debian 13 on; busybox's insmod wants them plain
            file, data = file.with_suffix(""), lzma.decompress(data)
        (root / "mod" / file.name).write_bytes(data)
        names.append(file.name)
    (root / "order").write_text("".join(f"{name}\n" for name in names))
    (root / "job").write_text(job)
    (root / "init").write_text(INIT)
    (root / "init").chmod(0o755)
    listing = "\n".join(str(path.relative_to(root)) for path in sorted(root.rglob("*")))
    packed = subprocess.run(
        ["cpio", "--quiet", "-o", "-H", "newc"],
        cwd=root,
        env={**os.environ, "PATH": SEARCHED},
        input=listing.encode(),
        stdout=subprocess.PIPE,
        check=True,
    ).stdout
    initramfs = folder / "initramfs"
    initramfs.write_bytes(gzip.compress(packed, compresslevel=1))
    return initramfs
