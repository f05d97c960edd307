"""From a status to sentences for a person: what is wrong, and what to do."""

from __future__ import annotations

import msgspec

from quavelet.sinks.status import Status


class Words(msgspec.Struct, frozen=True, kw_only=True):
    """One sentence of what is, one of what to do. level: "bad", "warn" or "good"."""

    level: str
    what: str
    do: str = ""


def words_of(status: Status) -> list[Words]:
    """The worst first; one that says so where all is well."""
    if status.state.startswith(("waiting", "lost")):
        return [Words(level="bad", what=f"No samples come: {status.state}.", do="Look at the wires and the supply.")]
    return [Words(level="good", what="All is well.")]
