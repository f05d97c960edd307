"""Debian's current kernel, downloaded but not installed, and a module built against its headers."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

TOOLS = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "cpio": "cpio",
    "modprobe": "kmod",
    "gcc": "gcc",
    "make": "make",
    "apt-get": "apt",
    "dpkg-deb": "dpkg",
}
SEARCHED = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"  # depmod and modprobe are there, for a user who is not root


class Missing(Exception):
    """Something of this machine that the guest needs; the text says what to install."""


@dataclass(frozen=True, slots=True)
class Kernel:
    """An unpacked kernel.

    folder   with boot/, lib/modules/ and usr/src/ below it
    release  as uname -r has it
    """

    folder: Path
    release: str

    @property
    def image(self) -> Path:
        return self.folder / "boot" / f"vmlinuz-{self.release}"

    def files_of(self, modules: Sequence[str]) -> list[Path]:
        """The files of these modules and of those they need, in the order of loading."""
        files: dict[Path, None] = {}
        for module in modules:
            command = ["modprobe", "-d", str(self.folder), "-S", self.release, "--show-depends", module]
            for line in run(command).splitlines():
                word, file = line.split()[:2]
                if word == "insmod":
                    files[Path(file)] = None
        return list(files)

    def built_module(self, source: Path) -> Path:
        """The module made of one C file; from the cache where that and the kernel are as they were."""
        digest = hashlib.sha256(source.read_bytes()).hexdigest()[:16]
        kept = self.folder / "built" / f"{source.stem}-{digest}.ko"
        if not kept.exists():
            headers = self.folder / "usr/src" / f"linux-headers-{self.release}"
            with tempfile.TemporaryDirectory() as name:
                shutil.copy(source, name)
                Path(name, "Kbuild").write_text(f"obj-m := {source.stem}.o\n")
                run(["make", "-C", str(headers), f"M={name}", "modules"])
                kept.parent.mkdir(exist_ok=True)
                shutil.copy(Path(name, f"{source.stem}.ko"), kept.with_suffix(f".{os.getpid()}"))
            kept.with_suffix(f".{os.getpid()}").rename(kept)
        return kept


def debian_kernel() -> Kernel:
    """The kernel that linux-image-amd64 stands for, from the cache or by `apt-get download`. Raises Missing."""
    lacking = [package for tool, package in TOOLS.items() if not shutil.which(tool, path=SEARCHED)]
    if lacking:
        raise Missing(f"no guest without them: apt install {' '.join(lacking)}")
    release = _release()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "quavelet-tests"
    folder = cache / f"linux-{release}"
    if not folder.exists():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache, prefix="unpacking-") as name:
            unpacked = Path(name, "kernel")
            _unpack(release, Path(name), unpacked)
            unpacked.rename(folder)
    return Kernel(folder, release)


def _release() -> str:
    try:
        told = run(["apt-cache", "depends", "linux-image-amd64"])
    except RuntimeError:
        told = ""
    found = re.search(r"Depends: linux-image-(\S+)", told)
    if found is None:
        raise Missing("apt knows no linux-image-amd64: apt-get update, on Debian and amd64")
    return found[1]


def _unpack(release: str, downloads: Path, folder: Path) -> None:
    series = ".".join(release.split(".")[:2])
    common = release.removesuffix("-amd64") + "-common"
    packages = [
        f"linux-image-{release}",
        f"linux-headers-{release}",
        f"linux-headers-{common}",
        f"linux-kbuild-{series}",
    ]
    try:
        run(["apt-get", "download", "-q", *packages], cwd=downloads)
    except RuntimeError as error:
        raise Missing(f"the kernel cannot be downloaded, try apt-get update: {error}") from error
    for package in sorted(downloads.glob("*.deb")):
        run(["dpkg-deb", "-x", str(package), str(folder)])
        package.unlink()
    # The headers find each other by absolute paths; the folder is renamed once it is complete.
    makefile = folder / "usr/src" / f"linux-headers-{release}" / "Makefile"
    makefile.write_text(f"include $(dir $(lastword $(MAKEFILE_LIST)))../linux-headers-{common}/Makefile\n")
    run(["depmod", "-b", str(folder), release])


def run(command: Sequence[str], *, cwd: Path | None = None) -> str:
    """What it prints. Raises RuntimeError with what it says where it fails."""
    environment = {**os.environ, "PATH": SEARCHED, "LC_ALL": "C"}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode:
        raise RuntimeError(f"{command[0]} fails: {(done.stderr or done.stdout).strip()[-500:]}")
    return done.stdout
