"""What a viewer of the page can do with what is behind it: each thing one small object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

from quavelet.sinks.message import Message


class Ability(Protocol):
    """Something that can be done from the page, and what is to be seen of it.

    All methods are called on the network's thread and must return at once; what takes long is for a thread of its own.
    """

    @property
    def name(self) -> str:
        """The word by which the page asks for it: "zero", "record", "play", ..."""
        ...

    def about(self) -> object:
        """What the page is to know once, when it connects: anything that msgspec encodes as JSON; None for nothing."""
        ...

    def state(self) -> object:
        """How it stands at this moment, in the same way; None for nothing. It is looked at ten times a second and sent
        when it has changed."""
        ...

    def see(self, message: Message) -> None:
        """Each message of the service, before any is left out."""
        ...

    def do(self, what: str, values: Mapping[str, object]) -> str:
        """Do it; one sentence of what was done. `values` come from a stranger: anything that JSON holds.

        Raises ImuError or ValueError with one sentence that says what to do instead; then nothing is changed.
        """
        ...

    def close(self) -> None:
        """End what is under way; called once, at the end of the program."""
        ...


@runtime_checkable
class HasFiles(Protocol):
    """An ability that made files, which a viewer may download from /recordings/NAME."""

    def open_file(self, name: str) -> Path | None:
        """The file of that name, from the ability's own list and never by joining a path; None for any other."""
        ...


@runtime_checkable
class HasPast(Protocol):
    """An ability that can go elsewhere in time, and knows what was before that."""

    def past(self, message: Message) -> Iterable[Message] | None:
        """Asked with each message before it is seen: None where it follows the one before; else time has jumped to it,
        and these were up to ten minutes before it, oldest first, ten a second are enough."""
        ...
