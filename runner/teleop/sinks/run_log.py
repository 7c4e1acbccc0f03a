"""What the `.rrd` of a run holds."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import rerun as rr

from runner.teleop.frames import Frames, RunResult, Status
from runner.teleop.sinks.look import Layout, layout_key, parameters_of, static_look
from runner.teleop.sinks.motion import send_com, send_estimates, send_motion, send_trail, thinned
from runner.viewer.rrd import written


def write_run(
    file: Path,
    result: RunResult,
    config: Mapping[str, Any],
    overrides: Mapping[str, Any],
    *,
    every: int,
    steps: bool,
) -> None:
    """Write a run.

    Args:
        file: Where to.
        result: The run.
        config: The resolved config as plain containers.
        overrides: What of it was set for this run.
        every: From one frame that is shown to the next.
        steps: Whether the physics steps are shown; else the updates are.
    """
    with written(file, Layout(layout_key(result))) as recording:
        title = " ".join([file.parent.name, *(f"{key}={value}" for key, value in overrides.items())])
        _log(recording, result, config, title, thinned(result.steps if steps else result.updates, every))
        if overrides:
            typed = dict(_leaves(config))  # a property must have one type in all recordings
            recording.send_property("overrides", [_value(k, typed.get(k, str(v))) for k, v in overrides.items()])


def _log(recording: rr.RecordingStream, result: RunResult, config: Mapping[str, Any], name: str, shown: Frames) -> None:
    """Send a run into an open recording."""
    recording.send_recording_name(name)
    recording.send_property("config", [_value(key, value) for key, value in _leaves(config)])
    recording.send_property("result", rr.AnyValues(**_outcome(result)))
    recording.log("summary", rr.TextDocument(_summary(result), media_type="text/markdown"), static=True)
    recording.send_chunks(static_look(result.estimators, tuple(parameters_of(result)), result.half_size_m))
    if result.update_count:
        send_motion(recording, result, shown)
        send_trail(recording, result)
        send_estimates(recording, result)
        send_com(recording, result)


def _leaves(config: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a nested config as `section.key`, as what Rerun can hold."""
    if isinstance(config, Mapping):
        for key, value in config.items():
            yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))
    else:
        yield prefix, config if isinstance(config, bool | int | float | str) else str(config)


@functools.lru_cache(maxsize=10_000, typed=True)
def _value(key: str, value: Any) -> rr.DescribedComponentBatch:
    """Return one value of a config; most are the same from run to run."""
    return rr.AnyValues(**{key: value}).as_component_batches()[0]


def _outcome(result: RunResult) -> dict[str, Any]:
    out: dict[str, Any] = {"status": result.status.value, "reason": result.reason}
    for name, parameters in result.parameters.items():
        for parameter, truth in parameters.items():
            out[f"{name}.{parameter}.true"] = truth.true
            out[f"{name}.{parameter}.start"] = truth.start
            if result.update_count:
                out[f"{name}.{parameter}.final"] = float(result.updates.column(f"{name}_{parameter}")[-1])
    return out


def _summary(result: RunResult) -> str:
    ok = result.status is Status.done
    lines = [
        "## Run" if ok else f"## {result.status.value}: {result.reason}",
        "",
        f"{result.step_count} physics steps of {1e3 * result.timestep_s:.4g} ms, {result.update_count} updates.",
        "",
        "| estimator | parameter | true | start | final | relative error |",
        "|---|---|---|---|---|---|",
    ]
    for name, parameters in result.parameters.items():
        for parameter, truth in parameters.items():
            last = float(result.updates.column(f"{name}_{parameter}")[-1]) if result.update_count else math.nan
            error = truth.error(last)
            lines.append(f"| {name} | {parameter} | {truth.true:g} | {truth.start:g} | {last:.9g} | {error:+.1e} |")
    lines += [
        "",
        "Solid: remote cube. Frame: local cube. Arrow: the push, drawn on top. Yellow line: the way of the remote.",
    ]
    return "\n".join(lines)
