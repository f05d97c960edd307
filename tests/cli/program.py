"""Running the installed program, and what to expect of what it says."""

import subprocess
import sysconfig
from dataclasses import dataclass
from pathlib import Path

PROGRAM = str(Path(sysconfig.get_path("scripts"), "quavelet"))
NOISE = ("Traceback", "Exception ignored", "Error:", "Warning:")
"""What the interpreter says when nobody has thought of a case."""


@dataclass(frozen=True, slots=True)
class Done:
    """How it ended, and what it wrote."""

    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        return self.out.splitlines()

    @property
    def said(self) -> list[str]:
        """The lines of stderr; all are the program's own."""
        lines = self.err.splitlines()
        assert [line for line in lines if not line.startswith("quavelet: ")] == []
        assert not any(noise in self.err for noise in NOISE), self.err
        return lines


def quavelet(*arguments: object, env: dict[str, str] | None = None) -> Done:
    """The finished program."""
    done = subprocess.run(
        [PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60, env=env, check=False
    )
    return Done(done.returncode, done.stdout, done.stderr)
