# ruff: noqa: E501
"""Breaks each rule of recovery in turn, in a copy of the tree, and says which test notices.

`python tests/faults/mutate_rules.py [NAME...]`; exit code 1 where a broken rule goes unnoticed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
DRIVER = "src/quavelet/mpu6050"
RECOVERY, FIFO, TIMES = (f"tests/mpu6050/test_mpu_{name}.py" for name in ("recovery", "fifo", "times"))
DATA_READY, BASE = "tests/mpu6050/test_mpu_data_ready.py", "tests/mpu6050/test_mpu_timebase.py"
START, SPIKES = "tests/mpu6050/test_mpu_start.py", "tests/faults/test_fault_spikes.py"
SELF, CYCLE, MOTION = (f"tests/mpu6050/test_mpu_{name}.py" for name in ("self_test", "low_power", "motion"))
MATRIX, TELLS = "tests/faults/test_fault_matrix.py", "tests/faults/test_fault_tells.py"


class Mutant(NamedTuple):
    """A rule, and how it is broken."""

    name: str
    file: str
    line: str
    broken: str
    tests: tuple[str, ...]
    only: str = ""


MUTANTS = (
    Mutant("retries off", "access.py", "TRIES = 3", "TRIES = 1", (FIFO,)),
    Mutant("FIFO read again after any error", "access.py", "n), _NOT_ACKNOWLEDGED)", "n), _PASSING)", (FIFO,)),
    Mutant("FIFO not emptied", "access.py", "self.write(r.USER_CTRL, r.USER_FIFO_RESET.mask)", "pass", (FIFO,)),
    Mutant("FIFO reset while it fills", "access.py", "self.write(r.FIFO_EN, 0)", "pass", (START,)),
    Mutant("register check off", "watch.py", "return now_ns >= self._due_ns", "return False", (RECOVERY,)),
    Mutant("one look at a register", "watch.py", "self._unlike(run) and self._unlike(run)", "self._unlike(run)", (RECOVERY,)),
    Mutant("changed register left", "watch.py", "self._chip.apply(row)", "pass", (RECOVERY,)),
    Mutant("WHO_AM_I not watched", "watch.py", "RegisterBits(r.WHO_AM_I, who_am_i, ~who_am_i & 0xFF),", "", (RECOVERY,)),
    Mutant("finding RESET ignored", "source.py", "if finding is Finding.RESET:", "if False:", (RECOVERY,)),
    Mutant("finding REWRITTEN ignored", "source.py", "if finding is not Finding.GOOD:", "if finding is Finding.RESET:", (RECOVERY,)),
    Mutant("FIFO reset not done", "source.py", "self._restart_due = self._check_due = True", "return", (FIFO,)),
    Mutant("failed FIFO reset forgotten", "source.py", "self._restart_due = self._check_due = True", "self._check_due = True", (RECOVERY,)),
    Mutant("no check after trouble", "source.py", "self._restart_due = self._check_due = True", "self._restart_due = True", (RECOVERY, MATRIX), "changed or rate"),
    Mutant("count not read again", "source.py", "if decoder.verdict(drain) is Verdict.MISALIGNED:", "if False:", (RECOVERY,)),
    Mutant("failure counter off", "source.py", "self._failures += 1", "pass", (FIFO,)),
    Mutant("failures never forgiven", "source.py", "self._failures = max(0, self._failures - 1)", "pass", (FIFO,)),
    Mutant("starvation off", "source.py", "if empty_ns > 2 * patience_ns:", "if False:", (RECOVERY,)),
    Mutant("starved FIFO not restarted", "source.py", "if empty_ns > patience_ns and", "if False and", (TELLS, RECOVERY), "starved or ten_seconds"),
    Mutant("hunger asks no register", "source.py", "if empty_ns > patience_ns // 2 and", "if False and", (MATRIX,), "0x23"),
    Mutant("stuck chip not reset", "source.py", "if stuck_s > STUCK_S and", "if False and", (RECOVERY,)),
    Mutant("never lost", "source.py", "if silent_ns > self._lost_ns:", "if False:", (FIFO, RECOVERY)),
    Mutant("overflow after the count", "source.py", "if new * self.info.frame_bytes >= room else 0", "if False else 0", (RECOVERY,)),
    Mutant("failed frames no gap", "source.py", "return self._lost(Loss.TRANSFER)", "return drain", (FIFO,)),
    Mutant("overflow bit ignored", "drain.py", "int_status & FIFO_OFLOW_INT.mask or", "", (FIFO,)),
    Mutant("full FIFO ignored", "drain.py", "or fifo_count >= fifo_bytes", "", (FIFO,)),
    Mutant("odd bytes ignored", "drain.py", "if fifo_count % frame_bytes:", "if False:", (FIFO,)),
    Mutant("near full ignored", "drain.py", "if fifo_count >= fifo_bytes - GUARD_FRAMES * frame_bytes:", "if False:", (FIFO,)),
    Mutant("temperature rule off", "plausible.py", "> TEMP_JUMP", "> 99999", (RECOVERY, TELLS)),
    Mutant("alike rule off", "plausible.py", "np.flatnonzero(jumps | alike)", "np.flatnonzero(jumps)", (RECOVERY, TELLS)),
    Mutant("stuck rule off", "decoder.py", "if alike >= self._stuck_after:", "if False:", (RECOVERY,)),
    Mutant("gap flag dropped", "decoder.py", "flags[0] |= s.pending", "pass", (FIFO,)),
    Mutant("time not advanced over a gap", "decoder.py", "taken += lost", "pass", (RECOVERY, TIMES), "jump or gap"),
    Mutant("gap has no length", "decoder.py", "gap_ns[0] = round(lost", "gap_ns[0] = round(0 * lost", (FIFO,)),
    Mutant("surprising count believed", "decoder.py", "if self._surprising(drain):", "if False:", (RECOVERY,)),
    Mutant("lost drain not told", "decoder.py", "if drain.seq != self._s.next_seq:", "if False:", (TIMES, "tests/recording")),
    Mutant("spike rule off", "spikes.py", "if off > bound and", "if False and", (SPIKES,)),
    Mutant("spike at the end not held", "spikes.py", "                held = k\n", "                held = len(rows)\n", (SPIKES,)),
    Mutant("first after a gap believed", "spikes.py", "before, began = (), True", "before, began = (), False", (SPIKES, MATRIX), "brought or first"),
    Mutant("spike leaves no gap", "spikes.py", "flags[k] |= np.uint32(owed_flags)", "pass", (SPIKES,)),
    Mutant("slow count timed", "timebase.py", "return s.observations > 0 and after_ns", "return False and after_ns", (TIMES, TELLS)),
    Mutant("rate out of bounds used", "timebase.py", "good = abs(fitted / self.nominal_ns - 1.0) <= BOUND", "good = True", (TIMES, TELLS)),
    Mutant("WHO_AM_I read once", "startup.py", "if who_am_i != MPU6050.who_am_i and self._chip.read", "if False and self._chip.read", (START,)),
    Mutant("exchanged chip driven on", "startup.py", "elif who_am_i != self.variant.who_am_i:", "elif False:", (RECOVERY,)),
    Mutant("configuration not read back", "startup.py", "if not row.holds(self._chip.read(row.register))]", "if False]", (START,)),
    Mutant("disturbed info believed", "startup.py", "if not self._is_as_written(read):", "if False:", (MATRIX, START), "0x75"),
    Mutant("other chip reset again and again", "startup.py", "self._new_try() if self.info is None else self._go(Step.PROBE, 0)", "self._new_try()", (MATRIX,), "swapped"),
    Mutant("two spoilt frames vouch for each other", "spikes.py", "after = after[1:] if spoilt else after", "pass", (SPIKES,)),
    Mutant("first samples not judged", "spikes.py", "began: bool = True", "began: bool = False", (SPIKES,)),
    Mutant("self-test: not repeated", "self_test.py", "REPEAT_WITHIN_NS = 6 *", "REPEAT_WITHIN_NS = -1 *", (SELF,)),
    Mutant("self-test: move not repeated", "self_test.py", "if report.still or clock", "if True or clock", (SELF,)),
    Mutant("self-test: lost setting measured with", "self_test.py", "check_rows(chip, [*held, *pushed])", "pass", (MATRIX,), "self_test and changed"),
    Mutant("self-test: frozen axes judged", "self_test.py", "if not got.sd.any():", "if False:", (SELF,)),
    Mutant("self-test: exchanged chip judged", "self_test.py", "if who_am_i != variant.who_am_i:", "if False:", (SELF,)),
    Mutant("self-test: other codes believed", "self_test.py", "if _nature(chip, variant) != nature:", "if False:", (SELF,)),
    Mutant("self-test: bits given back", "measuring.py", "byte & ~_SELF_TEST.get(register, 0)", "byte", (SELF,)),
    Mutant("self-test: not given back after an error", "measuring.py", "        with suppress(BusError, ChipUnstable):\n            _give_back(chip, found, clock)\n", "", (CYCLE,)),
    Mutant("self-test: given back unread", "measuring.py", "check_rows(chip, [r.RegisterBits(register, byte, ~byte & 0xFF) for register, byte in found])", "pass", (MATRIX,), "self_test and write"),
    Mutant("self-test: given back once", "measuring.py", "_MAX_GIVING_BACK = 5", "_MAX_GIVING_BACK = 1", (MATRIX,), "self_test and write"),
    Mutant("self-test: frames of other sensors", "measuring.py", "if sensors !=", "if False and sensors !=", (SELF,)),
    Mutant("idle: lost setting read with", "low_power.py", "        check_rows(chip, self._rows)\n        x, y, z", "        x, y, z", (CYCLE,)),
    Mutant("idle: lost setting waited for", "motion.py", "if now_ns >= min(end_ns, check_ns):", "if False:", (MOTION,)),
    Mutant("idle: motion of the settling told", "motion.py", "status.take(r.MOT_INT.mask)  #", "pass  #", (MOTION,)),
    Mutant("idle: bits of others eaten", "int_status.py", "self._held |= self.chip", "self._held = self.chip", (MOTION,)),
    Mutant("idle: stream's status taken", "int_status.py", "if chip.read(r.USER_CTRL)", "if False and chip.read(r.USER_CTRL)", (CYCLE,)),
    Mutant("pulse of another sample believed", "timebase.py", "<= FIT_PERIODS + unknown", "<= 1e9", (DATA_READY,)),
    Mutant("first pulse keeps the counts", "timebase.py", "if anew or not self._s.edges:", "if anew:", (BASE, DATA_READY)),
    Mutant("pulses fade as counts do", "timebase.py", "(EDGE_FADE_S if edge else FADE_S)", "FADE_S", (BASE,)),
    Mutant("count worth a pulse", "timebase.py", "keep *= EDGE_WORTH", "pass", (BASE, DATA_READY)),
    Mutant("noise taken for pulses", "pulses.py", "<= FIT_PERIODS + BOUND * n", "<= 1e9", (DATA_READY,)),
    Mutant("pulse close to the count believed", "pulses.py", "if edge is None or drain.before_ns - edge.t_ns < clear_ns:", "if edge is None:", (DATA_READY,)),
    Mutant("pulses missed for ever", "pulses.py", "s = replace(s, pulse_ns=newest.t_ns, missed=False)", "s = replace(s, pulse_ns=newest.t_ns)", (DATA_READY,)),
    Mutant("pulses never missed", "pulses.py", "elif not s.missed and now_ns", "elif False and now_ns", (DATA_READY,)),
    Mutant("vanished frame not told", "pulses.py", "return missing > 0", "return False", (DATA_READY,)),
    Mutant("line begun on old pulses", "pulses.py", "self._tell(taken, edge, anew=True)", "self._tell(taken, edge)", ("tests/mpu6050/test_mpu_pulses.py",)),
    Mutant("failing line stops the stream", "source.py", "edges = line.wait(0.0)\n        except BusError", "edges = line.wait(0.0)\n        except ZeroDivisionError", (DATA_READY,)),
    Mutant("latched pin left so", "config.py", "pin |= r.INT_LEVEL.mask | r.INT_OPEN.mask | r.LATCH_INT_EN.mask", "pass", (DATA_READY,)),
    Mutant("no end of tries", "startup.py", "or self._tries < MAX_TRIES", "or True", (START,)),
)  # fmt: skip


def killed_by(mutant: Mutant, tree: Path) -> str:
    """The test that notices, "" where none does. Raises ValueError where the rule is not found."""
    file = tree / DRIVER / mutant.file
    text = file.read_text()
    if mutant.line not in text:
        raise ValueError(f"'{mutant.line}' is not in {mutant.file}: the table is out of date")
    file.write_text(text.replace(mutant.line, mutant.broken))
    try:
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *mutant.tests]
        command += ["-k", mutant.only] if mutant.only else []
        env = {**os.environ, "PYTHONPATH": f"{tree / 'src'}:{tree}", "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.run(command, cwd=tree, env=env, capture_output=True, text=True, check=False)
    finally:
        file.write_text(text)
    found = re.search(r"^(?:FAILED|ERROR) (\S+)", run.stdout, re.MULTILINE)
    return found[1] if found else "" if run.returncode in (0, 5) else run.stdout[-200:]


def main() -> int:
    wanted = sys.argv[1:]
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "*.egg-info"))
        for mutant in MUTANTS:
            if wanted and not any(word in mutant.name for word in wanted):
                continue
            test = killed_by(mutant, tree)
            print(f"| {mutant.name} | {mutant.file} | {test or '**survived**'} |", flush=True)
            if not test:
                survivors.append(mutant.name)
    print(f"{len(survivors)} survived: {', '.join(survivors) or 'none'}")
    return 1 if survivors else 0


if __name__ == "__main__":
    raise SystemExit(main())
