"""Logs of a small arm in every format that is imported, written by the libraries that robots write them with."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd

ARM = """<mujoco><compiler angle="radian"/><option timestep="0.002"/><worldbody>
<body name="upper"><joint name="shoulder_pan" axis="0 0 1" range="-3 3" damping="0.5"/>
<inertial pos="0.1 0 0" mass="1" diaginertia=".01 .01 .01"/>
<body name="fore" pos="0.2 0 0"><joint name="elbow" axis="0 0 1" range="-2.5 2.5" damping="0.2"/>
<inertial pos="0.1 0 0" mass="0.5" diaginertia=".005 .005 .005"/></body></body></worldbody>
<actuator><motor name="shoulder_pan" joint="shoulder_pan" ctrlrange="-10 10"/>
<position name="elbow" joint="elbow" kp="8" kv="0.5"/></actuator></mujoco>"""
JOINTS = ("shoulder_pan", "elbow")
RATE_HZ, SAMPLES = 100, 120
DEG = np.pi / 180
START_NS = 1_700_000_000_000_000_000  # since 1970


@dataclass(frozen=True, eq=False)
class Run:
    """One simulated episode: times (T,), commands (T, 2), positions and velocities (T, 2), SI."""

    t: np.ndarray
    u: np.ndarray
    q: np.ndarray
    dq: np.ndarray

    @property
    def stamps(self) -> list[int]:
        """Times in ns since 1970."""
        return [START_NS + round(t * 1e9) for t in self.t]


def simulated(number: int) -> Run:
    """Simulate the arm for a second and a bit; runs differ by their number."""
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    t = np.arange(SAMPLES) / RATE_HZ
    u = np.stack([0.8 * np.sin(4 * t + number), 0.6 * np.sin(3 * t + 0.5 * number)], axis=1)
    q, dq = np.empty((SAMPLES, 2)), np.empty((SAMPLES, 2))
    for k in range(SAMPLES):
        q[k], dq[k] = data.qpos, data.qvel
        data.ctrl[:] = u[k]
        mujoco.mj_step(model, data, nstep=5)
    return Run(t, u, q, dq)


def entries(command: Callable[[int], str], position: Callable[[int], str], velocity: Callable[[int], str]) -> dict:
    """Return commands and channels of a map: positions and the servo's target in degrees."""
    units = ("N m", "deg")
    return {
        "commands": {f"u_{j}": {"signal": command(i), "actuator": j, "unit": units[i]} for i, j in enumerate(JOINTS)},
        "channels": {
            f"q_{j}": {"signal": position(i), "joint": j, "quantity": "position", "unit": "deg"}
            for i, j in enumerate(JOINTS)
        }
        | {
            f"dq_{j}": {"signal": velocity(i), "joint": j, "quantity": "velocity", "unit": "rad/s"}
            for i, j in enumerate(JOINTS)
        },
    }


def command_of(run: Run) -> np.ndarray:
    """Return the commands as logged: N m, degrees."""
    return run.u / [1.0, DEG]


def frame(run: Run) -> pd.DataFrame:
    """Return a run as a flat table."""
    u = command_of(run)
    columns = {"time": run.t}
    for i, j in enumerate(JOINTS):
        columns |= {f"cmd_{j}": u[:, i], f"{j}_pos": run.q[:, i] / DEG, f"{j}_vel": run.dq[:, i]}
    return pd.DataFrame(columns)


FLAT = {"clock": {"name": "time"}} | entries(
    lambda i: f"cmd_{JOINTS[i]}", lambda i: f"{JOINTS[i]}_pos", lambda i: f"{JOINTS[i]}_vel"
)
ROS = {"clock": {"name": "log_time"}} | entries(
    lambda i: f"/command/data[{i}]",
    lambda i: f"/joint_states/position[{JOINTS[i]}]",
    lambda i: f"/joint_states/velocity[{JOINTS[i]}]",
)
LEROBOT = {"clock": {"name": "timestamp"}} | entries(
    lambda i: f"action[{JOINTS[i]}.{('torque', 'pos')[i]}]",
    lambda i: f"observation.state[{JOINTS[i]}.pos]",
    lambda i: f"observation.velocity[{JOINTS[i]}.vel]",
)
ARRAYS = entries(lambda i: f"action[{i}]", lambda i: f"observations/qpos[{i}]", lambda i: f"observations/qvel[{i}]")

Written = tuple[list[Path], dict[str, Any]]
Import = Callable[..., tuple[int, str, str]]  # runs `runner import`: exit code, stdout, stderr


def csv(folder: Path, runs: list[Run]) -> Written:
    """One file each."""
    files = [folder / f"{k}.csv" for k in range(len(runs))]
    for file, run in zip(files, runs, strict=True):
        frame(run).to_csv(file, index=False)
    return files, FLAT


def tsv(folder: Path, runs: list[Run]) -> Written:
    """A folder of files, one each, with decimal commas."""
    inner = folder / "logs"
    inner.mkdir()
    for k, run in enumerate(runs):
        frame(run).to_csv(inner / f"{k}.tsv", index=False, sep="\t", decimal=",")
    return [inner], FLAT | {"log": {"decimal": ","}}


def plotjuggler(folder: Path, runs: list[Run]) -> Written:
    """Series that were sampled apart, a row for every time, in seconds since 1970; one file each."""
    files = []
    for k, run in enumerate(runs):
        late = pd.DataFrame({"__time": run.t + 1.7e9})
        for i, j in enumerate(JOINTS):
            late[f"/joint_states/{j}/position"] = run.q[:, i] / DEG
            late[f"/joint_states/{j}/velocity"] = run.dq[:, i]
        early = pd.DataFrame({"__time": run.t + 1.7e9 - 0.004})
        for i in range(2):
            early[f"/command/data[{i}]"] = command_of(run)[:, i]
        files.append(folder / f"{k}.csv")
        pd.concat([late, early]).sort_values("__time").to_csv(files[-1], index=False, float_format="%.15g")
    keys = entries(
        lambda i: f"/command/data[{i}]",
        lambda i: f"/joint_states/{JOINTS[i]}/position",
        lambda i: f"/joint_states/{JOINTS[i]}/velocity",
    )
    # the first command is 4 ms before the first measurement, and so the start of the episode
    return files, {"log": {"sparse": True}, "clock": {"name": "__time"}, "rows": {"at": "q_elbow"}} | keys


def parquet(folder: Path, runs: list[Run]) -> Written:
    """One file with a column that counts the runs, times in ms."""
    whole = pd.concat([frame(run).assign(run=3 * k, time=run.t * 1000) for k, run in enumerate(runs)])
    whole.to_parquet(folder / "log.parquet", index=False)
    keys = FLAT | {"clock": {"name": "time", "unit": "ms"}, "episodes": {"by": "column", "signal": "run"}}
    return [folder / "log.parquet"], keys


def _messages(run: Run, k: int) -> dict[str, dict]:
    """Return the messages of one sample; the names of the joints change their places."""
    order = (0, 1) if k % 2 else (1, 0)
    stamp = run.stamps[k] - 3_000_000  # measured 3 ms before it was written down
    header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
    return {
        "/command": {"data": command_of(run)[k].tolist()},
        "/joint_states": {
            "header": header,
            "name": [JOINTS[i] for i in order],
            "position": [float(run.q[k, i] / DEG) for i in order],
            "velocity": [float(run.dq[k, i]) for i in order],
        },
    }


def mcap_json(folder: Path, runs: list[Run]) -> Written:
    """One file each, JSON."""
    from mcap.writer import Writer

    files = []
    for n, run in enumerate(runs):
        files.append(folder / f"{n}.mcap")
        with files[-1].open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema("Any", "jsonschema", b'{"type": "object"}')
            channels = {t: writer.register_channel(t, "json", schema) for t in ("/command", "/joint_states")}
            for k, stamp in enumerate(run.stamps):
                for topic, message in _messages(run, k).items():
                    writer.add_message(channels[topic], stamp, json.dumps(message).encode(), stamp)
            writer.finish()
    return files, ROS


def mcap_protobuf(folder: Path, runs: list[Run]) -> Written:
    """One file each, protobuf."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.writer import Writer

    described = descriptor_pb2.FileDescriptorProto(name="arm.proto", package="arm", syntax="proto3")
    kind = described.message_type.add(name="Sample")
    names = ("u", "q", "dq")
    for number, name in enumerate(names, start=1):
        field = descriptor_pb2.FieldDescriptorProto
        kind.field.add(name=name, number=number, type=field.TYPE_DOUBLE, label=field.LABEL_REPEATED)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(described)
    sample = message_factory.GetMessageClass(pool.FindMessageTypeByName("arm.Sample"))
    files = []
    for n, run in enumerate(runs):
        files.append(folder / f"{n}.mcap")
        with files[-1].open("wb") as file:
            writer = Writer(file)
            writer.start()
            schemas = descriptor_pb2.FileDescriptorSet(file=[described]).SerializeToString()
            schema = writer.register_schema("arm.Sample", "protobuf", schemas)
            channel = writer.register_channel("/arm", "protobuf", schema)
            for k, stamp in enumerate(run.stamps):
                message = sample(u=command_of(run)[k], q=run.q[k] / DEG, dq=run.dq[k])
                writer.add_message(channel, stamp, message.SerializeToString(), stamp)
            writer.finish()
    keys = entries(lambda i: f"/arm/u[{i}]", lambda i: f"/arm/q[{i}]", lambda i: f"/arm/dq[{i}]")
    return files, {"clock": {"name": "log_time"}} | keys


def _ros_objects(types: Any, run: Run, k: int, *, ros1: bool) -> dict[str, Any]:
    name = "{}/msg/{}".format
    plain = _messages(run, k)
    state, stamp = plain["/joint_states"], plain["/joint_states"]["header"]["stamp"]
    time = types.types[name("builtin_interfaces", "Time")](**stamp)
    sequence = {"seq": k} if ros1 else {}
    header = types.types[name("std_msgs", "Header")](stamp=time, frame_id="", **sequence)
    joints = types.types[name("sensor_msgs", "JointState")](
        header=header, name=state["name"], position=np.array(state["position"]),
        velocity=np.array(state["velocity"]), effort=np.zeros(0),
    )  # fmt: skip
    layout = types.types[name("std_msgs", "MultiArrayLayout")](dim=[], data_offset=0)
    command = types.types[name("std_msgs", "Float64MultiArray")](
        layout=layout, data=np.array(plain["/command"]["data"])
    )
    return {"/joint_states": joints, "/command": command}


def _bag(storage: str) -> Callable[[Path, list[Run]], Written]:
    def write(folder: Path, runs: list[Run]) -> Written:
        """A folder each."""
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        types = get_typestore(Stores.ROS2_HUMBLE)
        bags = [folder / f"bag_{n}" for n in range(len(runs))]
        for bag, run in zip(bags, runs, strict=True):
            with Writer(bag, version=9, storage_plugin=StoragePlugin[storage]) as writer:
                made = _ros_objects(types, run, 0, ros1=False)
                topics = {t: writer.add_connection(t, m.__msgtype__, typestore=types) for t, m in made.items()}
                for k, stamp in enumerate(run.stamps):
                    for topic, message in _ros_objects(types, run, k, ros1=False).items():
                        raw = types.serialize_cdr(message, message.__msgtype__)
                        writer.write(topics[topic], stamp, raw)
        return bags, ROS

    return write


def ros1(folder: Path, runs: list[Run]) -> Written:
    """A bag each."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    bags = [folder / f"{n}.bag" for n in range(len(runs))]
    for bag, run in zip(bags, runs, strict=True):
        with Writer(bag) as writer:
            made = _ros_objects(types, run, 0, ros1=True)
            topics = {t: writer.add_connection(t, m.__msgtype__, typestore=types) for t, m in made.items()}
            for k, stamp in enumerate(run.stamps):
                for topic, message in _ros_objects(types, run, k, ros1=True).items():
                    writer.write(topics[topic], stamp, types.serialize_ros1(message, message.__msgtype__))
    return bags, ROS


def _lerobot(version: str) -> Callable[[Path, list[Run]], Written]:
    def write(folder: Path, runs: list[Run]) -> Written:
        """A data set; version 2 has a file per episode, version 3 has many episodes in one."""
        root = folder / "set"
        names = {"motors": [f"{j}.pos" for j in JOINTS]} if version == "v2.1" else [f"{j}.pos" for j in JOINTS]
        two = {"dtype": "float64", "shape": [2], "names": names}
        features = {
            "action": two | {"names": [f"{JOINTS[0]}.torque", f"{JOINTS[1]}.pos"]}, "observation.state": two,
            "observation.velocity": two | {"names": [f"{j}.vel" for j in JOINTS]},
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        }  # fmt: skip
        (root / "meta").mkdir(parents=True)
        info = {"codebase_version": version, "fps": RATE_HZ, "robot_type": "arm", "features": features}
        (root / "meta" / "info.json").write_text(json.dumps(info))
        frames = [
            pd.DataFrame({
                "action": list(command_of(run)), "observation.state": list(run.q / DEG),
                "observation.velocity": list(run.dq), "timestamp": run.t, "frame_index": np.arange(SAMPLES),
                "episode_index": k, "index": np.arange(SAMPLES) + k * SAMPLES, "task_index": 0,
            })
            for k, run in enumerate(runs)
        ]  # fmt: skip
        data = root / "data" / "chunk-000"
        data.mkdir(parents=True)
        if version == "v2.1":
            for k, one in enumerate(frames):
                one.to_parquet(data / f"episode_{k:06}.parquet")
        else:
            pd.concat(frames).to_parquet(data / "file-000.parquet")
        return [root], LEROBOT

    return write


def hdf5(folder: Path, runs: list[Run]) -> Written:
    """One file with a group for each episode, a reference, and no time."""
    import h5py

    with h5py.File(folder / "log.hdf5", "w") as file:
        for k, run in enumerate(runs):
            group = file.create_group(f"data/demo_{k}")
            group["action"] = command_of(run)
            group.create_dataset("observations/qpos", data=run.q / DEG, compression="gzip")
            group["observations/qvel"] = run.dq
            group.create_dataset("observations/images", data=np.zeros((len(run.t), 4, 4, 3), dtype="u1"))
        file.create_dataset("references", data=[file["data"].ref], dtype=h5py.ref_dtype)
    return [folder / "log.hdf5"], {"log": {"rate_hz": RATE_HZ}} | ARRAYS


def npz(folder: Path, runs: list[Run]) -> Written:
    """One file each, with a time."""
    files = [folder / f"{k}.npz" for k in range(len(runs))]
    for file, run in zip(files, runs, strict=True):
        arrays: Any = {"action": command_of(run), "observations/qpos": run.q / DEG, "t": run.t}
        arrays["observations/qvel"] = run.dq
        np.savez(file, **arrays)
    return files, {"clock": {"name": "t"}} | ARRAYS


def rrd(folder: Path, runs: list[Run]) -> Written:
    """One recording each."""
    import rerun as rr

    files = [folder / f"{k}.rrd" for k in range(len(runs))]
    for file, run in zip(files, runs, strict=True):
        with rr.RecordingStream("arm") as recording:
            recording.save(file)
            recording.log("/command", rr.SeriesLines(names=list(JOINTS)), static=True)
            time = rr.TimeColumn("sim_time", duration=run.t)
            recording.send_columns(
                "/command", [time], rr.Scalars.columns(scalars=command_of(run).ravel()).partition([2] * SAMPLES)
            )
            for i, j in enumerate(JOINTS):
                recording.send_columns(f"/measured/{j}/position", [time], rr.Scalars.columns(scalars=run.q[:, i] / DEG))
                recording.send_columns(f"/measured/{j}/velocity", [time], rr.Scalars.columns(scalars=run.dq[:, i]))
    keys = entries(
        lambda i: f"/command[{JOINTS[i]}]",
        lambda i: f"/measured/{JOINTS[i]}/position",
        lambda i: f"/measured/{JOINTS[i]}/velocity",
    )
    return files, {"clock": {"name": "sim_time"}} | keys


WRITERS: dict[str, Callable[[Path, list[Run]], Written]] = {
    "csv": csv, "tsv": tsv, "plotjuggler": plotjuggler, "parquet": parquet, "npz": npz, "hdf5": hdf5, "rrd": rrd,
    "mcap_json": mcap_json, "mcap_protobuf": mcap_protobuf, "mcap_ros2": _bag("MCAP"), "db3": _bag("SQLITE3"),
    "ros1": ros1, "lerobot_v2": _lerobot("v2.1"), "lerobot_v3": _lerobot("v3.0"),
}  # fmt: skip
