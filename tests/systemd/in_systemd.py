"""Scripts run as a job under a real systemd that is PID 1 of its own namespaces, with the unit on a fake chip."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
from pathlib import Path

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[1]
UNIT = REPOSITORY / "systemd" / "quavelet@.service"

TOLD_BUS = '''
"""The bus told:MOTION: a fake chip that can be told what happens to it while it runs. Each line of /run/faults is a
fault; opened while there is /run/absent nothing answers, while there is /run/stranger another chip does."""
from pathlib import Path
import numpy as np
from hw_fakes import TYPICAL, FakeBus, FakeMpu6050
from hw_fakes.faults.plan import parse
from hw_fakes.scenarios import motion_named
from hw_fakes.world.motion_base import EulerMotion

FAULTS, ABSENT, STRANGER = Path("/run/faults"), Path("/run/absent"), Path("/run/stranger")

class Stranger:
    def write(self, data): pass
    def read(self, n): return bytes([0x19]) * n
    def stop(self): pass

class Told(FakeBus):
    taken = 0

    def _transfer(self, messages):
        if FAULTS.exists() and self.targets:
            lines = FAULTS.read_text().splitlines()
            for line in lines[self.taken:]:
                self.adapter.faults.add(parse(line))
            self.taken = len(lines)
        return super()._transfer(messages)

class Turned(EulerMotion):
    "Turned by 40 deg about the vertical from 4 to 5 s, and lying still else."

    def euler_rad(self, t_s):
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        angles[:, 0] = 0.1
        angles[:, 2] = np.deg2rad(40) * np.clip(t_s - 4, 0, 1)
        rates[:, 2] = np.where((t_s > 4) & (t_s < 5), np.deg2rad(40), 0)
        return angles, rates

def open_told(which, *, clock):
    motion = Turned() if which == "turned" else motion_named(which)
    chip = Stranger() if STRANGER.exists() else FakeMpu6050(
        clock, motion=motion, imperfections=TYPICAL, seed=6050
    )
    return Told({} if ABSENT.exists() else {0x68: chip}, clock=clock, name="told:" + which)
'''

PREPARE = """
groupadd --force --system i2c
useradd --system --user-group --groups i2c --no-create-home --shell /usr/sbin/nologin quavelet
mkdir /etc/quavelet
sed 's/^name = "linux:1"/name = "fake:tilt"/' /opt/quavelet/repository/systemd/quavelet.toml > /etc/quavelet/imu0.toml
# As the udev rule would leave it.
if [ -n "$DMA" ]; then (umask 117; mknod /dev/cpu_dma_latency c $DMA; chgrp i2c /dev/cpu_dma_latency); fi
use_bus() { sed -i 's/^name = "fake:.*/name = "'"$1"'"/' /etc/quavelet/imu0.toml; }
(
    cd /opt/quavelet
    mkdir -p odd/told-0.dist-info
    cat > odd/told_bus.py <<'P'
TOLD_BUS
P
    printf 'Metadata-Version: 2.1\\nName: told\\nVersion: 0\\n' > odd/told-0.dist-info/METADATA
    printf '[quavelet.buses]\\ntold = told_bus:open_told\\n' > odd/told-0.dist-info/entry_points.txt
    sed -i 's#:/opt/quavelet/site#:/opt/quavelet/site:/opt/quavelet/odd#' venv/bin/python
)
edit() {
    mkdir -p /run/systemd/system/quavelet@imu0.service.d
    cat > /run/systemd/system/quavelet@imu0.service.d/edit.conf
    systemctl daemon-reload
}
property() { systemctl show --value -p "$1" quavelet@imu0; }
# The condition, looked at for as long as twenty seconds.
until_true() {
    for _ in $(seq 400); do if eval "$1"; then return; fi; sleep 0.05; done
    echo "never: $1"; told; exit 1
}
told() { journalctl --sync; journalctl -u quavelet@imu0 --no-pager -o cat; }
""".replace("TOLD_BUS", TOLD_BUS)


def in_systemd(tmp_path: Path, script: str) -> str:
    """What `script` prints; it must end well."""
    dma = Path("/dev/cpu_dma_latency")
    numbers = ""
    if dma.exists():
        device = dma.stat().st_rdev
        numbers = f"{device >> 8 & 0xFFF} {device & 0xFF | device >> 12 & 0xFFF00}"
    job = tmp_path / "job.sh"
    job.write_text(f'DMA="{numbers}"\n{PREPARE}\n{script}\n')
    done = subprocess.run(
        [
            "bash",
            HERE / "private_systemd.sh",
            job,
            UNIT,
            sys.base_prefix,
            sysconfig.get_path("purelib"),
            REPOSITORY,
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.stdout.endswith("job ended with 0\n"), done.stdout + done.stderr
    return done.stdout.removesuffix("job ended with 0\n")
