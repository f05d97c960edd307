"""Settings read again while the loop goes on: what can be changed at once, and what needs a restart."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import msgspec

from quavelet.core.errors import ImuError, SettingsError
from quavelet.settings import HOT_TABLES, Settings, as_tables, is_hot


@dataclass(frozen=True, slots=True)
class Changes:
    """Keys that differ, as "chip.dlpf", or "output.phone" for one that is new or gone."""

    hot: tuple[str, ...]
    restart: tuple[str, ...]

    def in_words(self) -> str:
        """One sentence of what came of them."""
        if not self.hot and not self.restart:
            return "the settings were read again, and nothing has changed"
        parts = []
        if self.hot:
            parts.append(f"in force: {', '.join(self.hot)}")
        if self.restart:
            parts.append(f"only after a restart: {', '.join(self.restart)}")
        return f"the settings were read again; {'; '.join(parts)}"


def changes(old: Settings, new: Settings) -> Changes:
    """What differs between two settings."""
    names = _differing(as_tables(old), as_tables(new))
    return Changes(
        tuple(name for name in names if is_hot(name)),
        tuple(name for name in names if not is_hot(name)),
    )


def with_hot(old: Settings, new: Settings) -> Settings:
    """The old settings with what is hot of the new ones. Raises SettingsError where these do not go together."""
    return msgspec.structs.replace(old, **{table: getattr(new, table) for table in HOT_TABLES})


class Reading:
    """The settings being read on a thread of its own, for a disk may take its time. `result` is None until it is
    done."""

    def __init__(self, load: Callable[[], Settings]) -> None:
        self.result: Settings | ImuError | None = None
        self._load = load
        self._thread = threading.Thread(target=self._run, name="settings", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        result: Settings | ImuError = SettingsError("the settings cannot be read, the log says why: mend the file")
        try:
            result = self._load()
        except ImuError as error:
            result = error
        finally:
            self.result = result

    def join(self) -> None:
        """Wait for it."""
        self._thread.join()


def _differing(old: Mapping[str, object], new: Mapping[str, object], place: str = "") -> list[str]:
    names: list[str] = []
    for key in dict.fromkeys((*old, *new)):
        name = f"{place}.{key}" if place else key
        before, after = old.get(key), new.get(key)
        if isinstance(before, dict) and isinstance(after, dict):
            names += _differing(before, after, name)
        elif before != after:
            names.append(name)
    return names
