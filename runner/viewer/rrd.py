"""Write an `.rrd` file and let go of what Rerun keeps of it.

Rerun holds on to every recording of a process, and to the stream through which its blueprint went, each with two
threads and up to a few megabytes: a sweep that writes thousands of files would fill the memory. It sweeps up recordings
that nobody refers to in `rr.init` alone, and the stream of a blueprint not at all, as its store refers to itself.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

from runner.storage.writing import write_bytes


class _Followed(rrb.Blueprint):
    """A blueprint that remembers the stream it was logged to."""

    def __init__(self, blueprint: rrb.Blueprint) -> None:
        self._blueprint = blueprint
        self._stream: rr.RecordingStream | None = None

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._blueprint._log_to_stream(stream)

    def let_go(self) -> None:
        """Part the stream from the store in memory that holds it."""
        if self._stream is not None:
            self._stream.disconnect()
            self._stream = None


@contextmanager
def written(path: Path, blueprint: rrb.Blueprint, application: str = "runner") -> Generator[rr.RecordingStream]:
    """Give a recording that goes to a file, and close it.

    Args:
        path: Of the file.
        blueprint: What a viewer shows at first.
        application: Recordings of one application share a viewer's settings.
    """
    layout = _Followed(blueprint)
    with rr.RecordingStream(application) as recording:
        # through memory: where the disk is full, Rerun's own thread that writes files ends with no more than a warning,
        # and what waits for it may wait for ever
        stream = recording.binary_stream()
        recording.send_blueprint(layout, make_active=False, make_default=True)
        layout.let_go()
        yield recording
        content = stream.read()
        recording.disconnect()
    write_bytes(path, content or b"")
    del recording, stream
    # whoever was given this recording may refer to it still: then it goes with the next one
    rerun_bindings.flush_and_cleanup_orphaned_recordings()
