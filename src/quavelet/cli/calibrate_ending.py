"""The end of `quavelet calibrate`: judged, saved, put into the chip where that is asked for, and told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from quavelet.bench.finding import Finding
from quavelet.bench.session_older import why_worse
from quavelet.bench.session_report import write_report
from quavelet.bench.session_result import Result
from quavelet.bench.session_store import SessionStore
from quavelet.bench.session_verdict import verdict
from quavelet.calibration.record import CalibrationRecord
from quavelet.calibration.record_file import (
    save_record,
)
from quavelet.cli import exits
from quavelet.cli.calibrate_told import Calibrated, tell
from quavelet.cli.run import talk
from quavelet.core.errors import CalibrationError, ImuError

RESUME = "the same command with --resume goes on with it"
MORE = "--resume with other --steps adds to it; to begin anew, remove it"


def tell_kept(store: SessionStore, *, then: str = RESUME) -> None:
    """Where what was measured is, and how to go on with it."""
    if words := store.last_words(then=then):
        talk(words)


InChip = Callable[[CalibrationRecord], tuple[CalibrationRecord, Finding]]


def ended(
    result: Result,
    out: Path,
    store: SessionStore | None,
    in_chip: InChip | None,
    *,
    src: str,
    json: bool,
    force: bool,
    report: Path | None,
) -> int:
    """Judges, saves, tells; gives the exit code. Raises CalibrationError where it should be saved and cannot be.

    in_chip   puts what was saved into the chip as well, None where that was not asked for
    """
    findings, record, failure = verdict(result), result.record, None
    bad = [finding.name for finding in findings if not finding.ok]
    worse = why_worse(result, out)
    word = "not good enough" if bad else "worse" if worse else "good"
    reason = ""
    if (bad or worse) and not force:
        reason = f"not good enough: {', '.join(bad)}" if bad else f"the one at {out} is better: {worse}"
        reason += "; nothing is saved (--resume --force does, without measuring again)"
    elif not result.merged.fresh:
        reason = "these steps calibrate nothing, so nothing is saved"
    saved = None
    if not reason:
        try:
            # The factory's words and this record are right together, whatever comes of the chip's own offsets.
            save_record(record, out, even_if_worse=force)
            saved = str(out)
            if in_chip is not None:
                record, finding, failure = _put_in_chip(record, in_chip, out)
                findings.append(finding)
        except (CalibrationError, KeyboardInterrupt) as error:
            if saved and isinstance(error, KeyboardInterrupt):
                talk(f"{saved} is saved, for the chip without offsets: none are in it")
            if store is not None:
                tell_kept(store)
            raise
    finished = failure is None and (saved is not None or not (bad or worse))
    if store is not None and finished:
        store.forget()
    told = Calibrated(
        v=1,
        src=src,
        verdict=word,
        saved=saved,
        reason=reason,
        findings=tuple(findings),
        record=record,
        noise=tuple(one.figures() for one in result.noise),
    )
    tell(told, as_json=json)
    if store is not None and not finished:
        tell_kept(store, then=MORE if reason else RESUME)
    if report is not None:
        # Last, so that a page that cannot be written takes nothing else with it.
        write_report(report, result, findings, src=src, verdict=word, saved=saved, reason=reason)
        talk(f"{report} written")
    if failure is not None:
        return exits.exit_code(failure)
    return exits.VERDICT_FAILED if bad or worse else exits.OK


def _put_in_chip(
    record: CalibrationRecord, in_chip: InChip, out: Path
) -> tuple[CalibrationRecord, Finding, ImuError | None]:
    """The record that is saved at last, what is to be told, and what went wrong, None where nothing did.

    Raises CalibrationError where the record cannot be saved.
    """
    try:
        record, finding = in_chip(record)
    except ImuError as error:
        finding = Finding(
            name="chip's offsets",
            ok=False,
            found=f"not written: {error}",
            advice="the calibration is saved and good without them; the same command with --resume tries it once more",
        )
        return record, finding, error
    save_record(record, out, even_if_worse=True)
    return record, finding, None
