"""Make cases whose answers are withheld: recordings of the second physics, and what was planted in them elsewhere.

How large an effect is follows from how far it moves the recording, not from its parameter: `error_ratio` is the rms
difference between the recording and a simulation of what the owner believes, started from the true state, over all
samples and channels, in units of the noise. With nothing but noise it is 1. The parameter is found by bracketing and
regula falsi on that ratio.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.ndimage import map_coordinates

from runner.blind.excite import Drive, draw_episodes
from runner.blind.ledger import Ledger
from runner.blind.physics import (
    TEXTURE_CELL_M,
    Episode,
    IntegrationError,
    World,
    base_points,
    floor_texture,
    simulate_all,
)
from runner.blind.plants import OUTSIDE, TOGETHER_ALIKE, VOCABULARY, Plant, Scene, draw
from runner.errors import ConfigError, check_range
from runner.progress import track
from runner.storage.writing import write_parquet, write_text, write_yaml

BANDS: dict[str, tuple[float, float]] = {"subtle": (1.6, 3.0), "moderate": (4.0, 7.0), "strong": (10.0, 30.0)}
PAIR_BANDS: dict[str, tuple[float, float]] = {"moderate": (4.0, 7.0), "strong": (10.0, 16.0)}
KINDS = ("position", "position", "yaw", "velocity", "velocity", "rate")  # of the six channels
COLUMNS = ("x", "y", "yaw", "vx", "vy", "wz")
HASH_FILE = "answers.sha256"
SMALLEST = 1e-5  # of the largest size: below, an effect is not looked for
FIRST_SIZE = 0.03  # of the largest size: where the search begins
ATTEMPTS = 40
COARSE = {"points": 8, "rtol": 1e-6, "atol": 1e-8}  # for finding sizes: a quarter of the time


@dataclass(frozen=True)
class Mix:
    """Shares of the kinds of cases; they are normalised by their sum."""

    singles: float = 0.62
    pairs: float = 0.14
    nulls: float = 0.12
    unknowns: float = 0.12

    def __post_init__(self) -> None:
        for name, share in asdict(self).items():
            check_range(f"blind.mix.{name}", share, 0.0)
        if sum(asdict(self).values()) <= 0.0:
            raise ConfigError("blind.mix: at least one share must be above 0.")


@dataclass(frozen=True)
class Reality:
    """How a case departs from the textbook besides its effect. Each can be switched off by zero.

    Args:
        texture: Range of the standard deviation of friction over the floor, relative.
        wrong_size: Range of the relative error of the nominal half size.
        mismatch_limit: The rms of both on the trajectories, in units of the noise; each is shrunk to keep it.
        coloured: Share of cases whose noise is slow in part: 40 % to all of its variance, for 20 to 120 ms.
        outliers: Share of cases in which one sample in 200 is far off.
        noise_unknown, noise_partly: Shares of cases whose noise is not stated, or only in part.
        noise_fine: Share of cases with a noise of one or two millimetres, instead of three to thirteen.
        heights: Share of cases with pushes above and below the centre.
        boxes: Share of cases with a box instead of a cube.
        corners: Share of cases whose object bears on its corners and is believed to.
    """

    texture: tuple[float, float] = (0.005, 0.01)
    wrong_size: tuple[float, float] = (0.002, 0.005)
    mismatch_limit: float = 0.6
    coloured: float = 0.18
    outliers: float = 0.08
    noise_unknown: float = 0.25
    noise_partly: float = 0.15
    noise_fine: float = 0.06
    heights: float = 0.2
    boxes: float = 0.35
    corners: float = 0.04


@dataclass(frozen=True)
class Job:
    """One case to make: what kind, which effects at which severity (drawn beforehand, so that a set is balanced)."""

    kind: str  # single, pair, null, unknown
    wanted: tuple[tuple[str, str], ...]  # (effect, severity)
    seed: tuple[int, ...]


@dataclass(frozen=True)
class MadeCases:
    """What `make_cases` made.

    Args:
        folder: One folder for each case, and the hash of the answers.
        answers: File of the answers.
        sha256: Of that file.
        cases: Names of the cases.
        seconds: Wall time.
    """

    folder: Path
    answers: Path
    sha256: str
    cases: tuple[str, ...] = field(repr=False)
    seconds: float


def make_cases(
    n: int,
    seed: int,
    out_dir: Path | str,
    answers_path: Path | str,
    *,
    mix: Mix | None = None,
    reality: Reality | None = None,
    workers: int | None = None,
) -> MadeCases:
    """Make n cases; the same seed makes the same cases, whatever the number of workers.

    What was made before an interruption is kept, and its answers in a file beside the one for all of them: called
    again with the same arguments, this goes on from there.

    Args:
        n: Number of cases.
        seed: Of everything that is drawn.
        out_dir: Folder for the cases: must not exist, be empty, or be that of an interrupted call.
        answers_path: File for the answers, outside `out_dir`.
        mix: Shares of singles, pairs, nulls and unknowns.
        reality: Departures from the textbook.
        workers: Processes; none: one for each core.

    Raises:
        ConfigError: If the folder is in use or can't be made, or the answers would lie inside it.
        ResultError: If an interrupted call was for other cases, or the answers can't be written.
    """
    check_range("blind.n", n, 1, 100000)
    folder, answers = Path(out_dir), Path(answers_path)
    if folder.resolve() == answers.resolve().parent or folder.resolve() in answers.resolve().parents:
        raise ConfigError(f"blind.answers: must lie outside the folder of the cases '{folder}', got '{answers}'.")
    kept = part_of(answers)
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"blind.out: '{folder}' is a file; give a folder.")
    if folder.exists() and any(folder.iterdir()) and not kept.exists():
        raise ConfigError(f"blind.out: the folder '{folder}' is not empty; give one that is new.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        answers.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"blind.out: '{error.filename}' can't be made: {error.strerror}.") from None
    begun = time.perf_counter()
    mix, reality = mix or Mix(), reality or Reality()
    belongs = {"n": n, "seed": seed, "out": str(folder.resolve()), "mix": asdict(mix), "reality": asdict(reality)}
    ledger = Ledger(kept, belongs)
    names = _names(n, seed)
    todo = [(job, name) for job, name in zip(plan_jobs(n, seed, mix), names, strict=True) if name not in ledger.done]
    calls = (delayed(make_case)(job, reality, folder / name) for job, name in todo)
    results = Parallel(n_jobs=workers or os.cpu_count() or 1, return_as="generator_unordered")(calls)
    results = cast("Iterable[tuple[str, dict]]", results)
    for name, answer in track(results, "Making cases", total=len(todo), unit="cases"):
        ledger.add(name, answer)
    text = json.dumps({name: ledger.done[name] for name in sorted(names)}, indent=1) + "\n"
    write_text(answers, text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    write_text(folder / HASH_FILE, f"{digest}  {answers.name}\n")
    kept.unlink()
    return MadeCases(folder, answers, digest, tuple(sorted(names)), time.perf_counter() - begun)


def part_of(answers: Path) -> Path:
    """Return the file that holds the answers of the cases made so far."""
    return answers.with_name(f"{answers.name}.part")


def _names(n: int, seed: int) -> list[str]:
    generator = np.random.default_rng([seed, 99])
    names: dict[str, None] = {}
    while len(names) < n:
        names["r" + generator.bytes(5).hex()] = None
    return list(names)


def plan_jobs(n: int, seed: int, mix: Mix) -> list[Job]:
    """Return what each case is to hold: counts by largest remainder, effects and severities from shuffled decks."""
    generator = np.random.default_rng([seed, 1])
    shares = asdict(mix)
    exact = {kind: n * share / sum(shares.values()) for kind, share in shares.items()}
    counts = {kind: math.floor(value) for kind, value in exact.items()}
    for kind in sorted(exact, key=lambda k: counts[k] - exact[k])[: n - sum(counts.values())]:
        counts[kind] += 1
    wanted: list[tuple[str, tuple[tuple[str, str], ...]]] = []
    wanted += [("single", (card,)) for card in _deal(counts["singles"], list(VOCABULARY), list(BANDS), generator)]
    wanted += [
        ("unknown", (card,)) for card in _deal(counts["unknowns"], list(OUTSIDE), ["moderate", "strong"], generator)
    ]
    wanted += [("null", ())] * counts["nulls"]
    names = list(VOCABULARY)
    for _ in range(counts["pairs"]):
        pair: list[str] = []
        while len(pair) < 2 or set(pair) in TOGETHER_ALIKE:
            pair = [names[int(i)] for i in generator.choice(len(names), 2, replace=False)]
        pair.sort(key=lambda name: name != "mass")  # its inertia comes before one of its own
        severities = generator.choice(list(PAIR_BANDS), 2)
        wanted.append(("pair", tuple((name, str(s)) for name, s in zip(pair, severities, strict=True))))
    order = generator.permutation(n)
    return [Job(*wanted[int(i)], seed=(seed, 2, number)) for number, i in enumerate(order)]


def _deal(count: int, names: list[str], severities: list[str], generator: np.random.Generator) -> list[tuple[str, str]]:
    # every name once before any twice, and every severity equally often
    cards: list[tuple[str, str]] = []
    shift = generator.permutation(len(names))
    round_number = 0
    while len(cards) < count:
        order = generator.permutation(len(names))
        cards += [(names[int(i)], severities[int(shift[i] + round_number) % len(severities)]) for i in order]
        round_number += 1
    return cards[:count]


def make_case(job: Job, reality: Reality, folder: Path) -> tuple[str, dict]:
    """Write one case into its folder and return its name and its answer.

    Where a severity can't be reached with a sensible size, the next lower one is tried, then everything is drawn anew.
    """
    generator = np.random.default_rng(job.seed)
    for _ in range(ATTEMPTS):
        made = _try_case(job, reality, generator)
        if made is not None:
            nominal, table, answer = made
            folder.mkdir(parents=True, exist_ok=True)
            write_yaml(folder / "nominal.yaml", nominal)
            write_parquet(folder / "recording.parquet", table)
            return folder.name, answer
    raise ConfigError(f"blind.effect: no sensible size of {job.wanted} reaches its severity in {ATTEMPTS} tries.")


def _try_case(job: Job, reality: Reality, g: np.random.Generator) -> tuple[dict, pd.DataFrame, dict] | None:
    believed = _draw_world(reality, g)
    rate_hz = float(g.choice([60, 60, 60, 100, 120, 240, 240]))
    drive = Drive(believed, rate_hz, heights=bool(g.random() < reality.heights))
    episodes = draw_episodes(drive, g)
    noise = _draw_noise(believed, reality, g)
    sigma = np.array([noise[kind] for kind in KINDS])
    coarse, nominal_paths = simulate_or_none(believed, episodes, **COARSE), simulate_or_none(believed, episodes)
    if coarse is None or nominal_paths is None:
        return None
    scene = Scene(believed, episodes, coarse)
    real, mismatch = _mismatched(scene, reality, sigma, g)

    world, effects, accept = real, [], set()
    for name, severity in job.wanted:
        plant = draw(name, replace(scene, world=real), g)
        bands = PAIR_BANDS if job.kind == "pair" else BANDS
        sized = _size_for(
            plant, severity, bands, real, scene, sigma, g, lowest="moderate" if job.kind != "single" else "subtle"
        )
        if sized is None:
            return None
        size, reached = sized
        true = {k: v if isinstance(v, str) else float(v) for k, v in plant.true(world, size).items()}
        if job.kind == "unknown":
            effects.append({"name": "unknown", "severity": reached, "true": {"what": name, **true}})
        else:
            effects.append({"name": name, "severity": reached, "true": true})
        world = plant.edit(world, size)
        accept |= set(plant.accept)
    paths = simulate_or_none(world, episodes)
    if paths is None or not _within_bands(_ratio(paths, nominal_paths, sigma), effects):
        return None
    slow_share = float(g.uniform(0.4, 1.0)) if g.random() < reality.coloured else 0.0
    slow_s = float(np.exp(g.uniform(math.log(0.02), math.log(0.12))))
    colour = slow_share, math.exp(-1.0 / (slow_s * rate_hz))
    outliers = 0.005 if g.random() < reality.outliers else 0.0
    measured = [path + _noise(len(path), sigma, colour, outliers, g) for path in paths]
    difference = np.concatenate([(m - p) / sigma for m, p in zip(measured, nominal_paths, strict=True)])
    answer = {
        "effects": effects,
        "error_ratio": round(float(np.sqrt(np.mean(difference**2))), 3),
        "accept": sorted(accept) or ["none"],
        "made": {
            "kind": job.kind,
            "mismatch_ratio": round(_ratio(simulate_or_none(real, episodes), nominal_paths, sigma), 4),
            "mismatch": mismatch,
            "noise": noise,
            "noise_slow_share": round(slow_share, 3),
            "noise_slow_s": round(slow_s, 4),
            "outlier_share": outliers,
            "starts": [[round(float(v), 6) for v in e.start] for e in episodes],
        },
    }
    table = _table(episodes, measured, heights=drive.heights)
    return _nominal(believed, rate_hz, noise, reality, g), table, answer


def _within_bands(excess: float, effects: list[dict]) -> bool:
    # sizes were found with coarse points; a single effect must keep its severity with the fine ones
    if len(effects) != 1:
        return True
    low, high = BANDS[effects[0]["severity"]]
    return 0.95 * low <= math.sqrt(1.0 + excess * excess) <= 1.05 * high


def simulate_or_none(world: World, episodes: Sequence[Episode], **options: float) -> list[np.ndarray] | None:
    """Return the motion, or none where the world can't be integrated (it tips, or it runs away)."""
    try:
        return simulate_all(world, list(episodes), **options)
    except IntegrationError:
        return None


def _ratio(paths: list[np.ndarray] | None, nominal: list[np.ndarray], sigma: np.ndarray) -> float:
    if paths is None:
        return math.inf
    difference = np.concatenate([(a - b) / sigma for a, b in zip(paths, nominal, strict=True)])
    return float(np.sqrt(np.mean(difference**2)))


def _size_for(
    plant: Plant,
    severity: str,
    bands: dict[str, tuple[float, float]],
    real: World,
    scene: Scene,
    sigma: np.ndarray,
    g: np.random.Generator,
    *,
    lowest: str,
) -> tuple[float, str] | None:
    """Return the size that reaches a severity, or the next lower one, and its name; none where none can be reached."""

    @functools.cache
    def excess(size: float) -> float:
        # the ratio without noise, which adds 1 in squares
        return _ratio(simulate_or_none(plant.edit(real, size), scene.episodes, **COARSE), scene.paths, sigma)

    names = [name for name in ("strong", "moderate", "subtle") if name in bands]
    for name in names[names.index(severity) : names.index(lowest) + 1]:
        low, high = bands[name]
        target = math.sqrt(float(np.exp(g.uniform(math.log(1.08 * low), math.log(0.92 * high)))) ** 2 - 1.0)
        share = float(g.uniform(0.2, 0.9))
        size = find_size(excess, plant.largest, target)
        if size is None:
            least, top = math.sqrt((1.04 * low) ** 2 - 1.0), excess(plant.largest)
            if least < top < target:
                size = find_size(excess, plant.largest, least * (top / least) ** share)
        if size is not None:
            return size, name
    return None


def find_size(excess: Callable[[float], float], largest: float, target: float) -> float | None:
    """Return a size with an excess within 6 % of the target, or none: regula falsi in logarithms, inside a bracket.

    Args:
        excess: Excess at a size; rises with it, at least on the whole.
        largest: Largest size.
        target: Excess to reach.
    """
    low, high = math.log(largest * SMALLEST), math.log(largest)
    at_low, at_high = -8.0, math.nan  # errors at the ends; the upper end is looked at only where it has to be
    guess = high + math.log(FIRST_SIZE)
    for step in range(24):
        error = min(max(math.log(max(excess(math.exp(guess)), 1e-12) / target), -8.0), 8.0)
        if abs(error) < 0.06:
            return math.exp(guess)
        if error > 0:
            at_low *= 0.5 if high < math.log(largest) else 1.0  # Illinois: the lower end must not be stuck
            high, at_high = guess, error
        elif guess >= math.log(largest):
            return None  # the largest size does too little
        else:
            at_high *= 0.5 if at_low > -8.0 else 1.0
            low, at_low = guess, error
        if high - low < 1e-6:
            return None  # the excess jumps over the target
        if step < 2 or math.isnan(at_high):
            guess = min(guess - error, high)  # the excess is about proportional to the size
        else:
            guess = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < guess <= high or (step % 4 == 3 and not math.isnan(at_high)):
            guess = 0.5 * (low + high)
    return None


def _draw_world(reality: Reality, g: np.random.Generator) -> World:
    """Draw what the owner believes: in a quarter of the cases the cube of half a metre, 3 kg and friction 0.3."""
    if g.random() < 0.25:
        return World(half_size=(0.5, 0.5, 0.5), mass=3.0, friction=0.3)
    half = round(float(g.uniform(0.2, 0.6)), 3)
    sizes = (half, half, half)
    if g.random() < reality.boxes:
        sizes = (half, round(half * float(g.uniform(0.55, 1.5)), 3), round(half * float(g.uniform(0.4, 1.2)), 3))
    mass = round(float(np.exp(g.uniform(math.log(0.5), math.log(6.0)))), 3)
    tips = min(sizes[:2]) / sizes[2]
    friction = round(float(g.uniform(0.1, min(0.6, 0.65 * tips))), 3)
    contact = "corners" if g.random() < reality.corners else "patch"
    return World(half_size=sizes, mass=mass, friction=friction, contact=contact)


def _draw_noise(world: World, reality: Reality, g: np.random.Generator) -> dict[str, float]:
    """Draw standard deviations with two digits."""
    fine = g.random() < reality.noise_fine
    position = float(np.exp(g.uniform(*np.log((0.001, 0.002) if fine else (0.003, 0.013)))))
    half = max(world.half_size[:2])
    velocity = position * float(g.uniform(2.5, 5.0))
    drawn = {
        "position": position,
        "yaw": position / half * float(g.uniform(0.35, 0.95)),
        "velocity": velocity,
        "rate": velocity / half * float(g.uniform(0.45, 1.15)),
    }
    return {kind: float(f"{value:.2g}") for kind, value in drawn.items()}


def _mismatched(
    scene: Scene, reality: Reality, sigma: np.ndarray, g: np.random.Generator
) -> tuple[World, dict[str, float]]:
    """Return the real world without any effect: an uneven floor and a slightly other size, and by how much."""
    texture = float(g.uniform(*reality.texture))
    wrong = float(g.choice([-1.0, 1.0]) * g.uniform(*reality.wrong_size))
    seed, length = int(g.integers(2**31)), float(g.uniform(0.25, 0.6))
    real = scene.world
    if texture > 0.0:
        real = replace(real, texture=texture, texture_seed=seed, texture_length=length)
        real = replace(real, texture_mean=_mean_texture(real, scene.paths))
    # each by itself within its half (in squares) of the limit
    limit = reality.mismatch_limit / math.sqrt(2.0)

    def shrunk(size: float, world_of: Callable[[float], World]) -> float:
        for _ in range(6):
            ratio = _ratio(simulate_or_none(world_of(size), scene.episodes, **COARSE), scene.paths, sigma)
            if size == 0.0 or ratio <= limit:
                break
            size *= max(0.9 * limit / ratio, 0.05)
        return size

    def resized(world: World, share: float) -> World:
        hx, hy, hz = (h * (1.0 + share) for h in scene.world.half_size)
        return replace(world, half_size=(hx, hy, hz))

    texture = shrunk(texture, lambda size: replace(real, texture=size))
    wrong = shrunk(wrong, lambda size: resized(scene.world, size))
    real = resized(replace(real, texture=texture), wrong)
    return real, {"texture": round(texture, 6), "texture_length_m": round(length, 3), "half_size": round(wrong, 6)}


def _mean_texture(world: World, paths: list[np.ndarray]) -> float:
    """Return the mean of the texture under the moving box, in units of its standard deviation."""
    x, y, share, _ = base_points(world, 6)
    path = np.concatenate(paths)
    path = path[np.hypot(path[:, 3], path[:, 4]) + abs(path[:, 5]) * world.half_size[0] > 0.02]
    if not len(path):
        return 0.0
    c, s = np.cos(path[:, 2])[:, None], np.sin(path[:, 2])[:, None]
    places = np.stack([path[:, :1] + c * x - s * y, path[:, 1:2] + s * x + c * y]) / TEXTURE_CELL_M
    values = map_coordinates(floor_texture(world), places.reshape(2, -1), order=1, mode="grid-wrap")
    return float(np.mean(values.reshape(len(path), -1) @ share))


def _noise(
    n: int, sigma: np.ndarray, colour: tuple[float, float], outliers: float, g: np.random.Generator
) -> np.ndarray:
    """Return noise (n, 6), some samples far off; `colour`: share that is autoregressive, correlation of samples."""
    share, memory = colour
    white = math.sqrt(1.0 - share) * g.standard_normal((n, 6))
    if share > 0.0:
        slow = g.standard_normal((n, 6))
        for k in range(1, n):
            slow[k] = memory * slow[k - 1] + math.sqrt(1.0 - memory * memory) * slow[k]
        white += math.sqrt(share) * slow
    if outliers > 0.0:
        far = g.random((n, 6)) < outliers
        white[far] += (g.choice([-1.0, 1.0], far.sum())) * g.uniform(5.0, 15.0, far.sum())
    return white * sigma


def _table(episodes: list[Episode], measured: list[np.ndarray], *, heights: bool) -> pd.DataFrame:
    rows = []
    for e, m in zip(episodes, measured, strict=True):
        n = len(m)
        row = {"episode": np.full(n, e.number, np.int32), "t": np.arange(n) / e.rate_hz}
        row |= dict(zip(COLUMNS, m.T, strict=True))
        row |= dict(zip(("fx", "fy", "px", "py", "pz"), e.command.T, strict=True))
        rows.append(pd.DataFrame(row))
    table = pd.concat(rows, ignore_index=True)
    if not heights:
        table = table.drop(columns="pz")
    return table.astype({name: np.float32 for name in table.columns if name != "episode"})


def _nominal(world: World, rate_hz: float, noise: dict[str, float], reality: Reality, g: np.random.Generator) -> dict:
    sizes = world.half_size
    drawn = g.random()
    stated: dict[str, float | None] | None = dict(noise)
    if drawn < reality.noise_unknown:
        stated = None
    elif drawn < reality.noise_unknown + reality.noise_partly:
        hidden = g.choice(list(noise), size=int(g.integers(1, len(noise))), replace=False)
        stated = {kind: None if kind in hidden else value for kind, value in noise.items()}
    nominal: dict = {
        "half_size": sizes[0] if sizes[0] == sizes[1] == sizes[2] else list(sizes),
        "mass": world.mass,
        "friction": world.friction,
        "gravity": world.gravity,
        "rate_hz": int(rate_hz),
        "noise": stated,
    }
    if world.contact != "patch":
        nominal["contact"] = world.contact
    return nominal
