"""The short form of the soak of all outputs."""

from __future__ import annotations

from soak_outputs import BOUND_MB, DATAGRAMS, soak


def test_with_every_output_on_memory_stays_and_recordings_keep_their_bound(tmp_path, capsys):
    found = soak(200_000, tmp_path)
    with capsys.disabled():
        print(f"\nall outputs, 200000 samples: memory grew by {found.growth_mb:.1f} MB")
    # The rotation begins after the first 20 MB, which the long run comes to; a leak of 100 bytes a sample is seen here.
    assert found.growth_mb < 20.0
    assert found.recorded_mb <= BOUND_MB
    assert found.asked == 20
    sent = {output.name: output.sent for output in found.status.outputs}
    assert all(sent[name] > 15_000 for name in (*DATAGRAMS, "socket"))
    assert 500 < sent["slow"] < 3000
    assert next(output.lost for output in found.status.outputs if output.name == "socket") > 1000
