"""The README's pictures: two flights in motion, drawn by the environment itself, and the still figures.

An animation shows a flight at half speed: every step one frame, and the last for a while. All frames share one palette,
so that what stands still in the flight stands still in the picture.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from flatgym import SCENARIOS
from flatgym.files import write_text, write_whole
from flatgym.scenarios.reference import Reference, reference

Pixels = NDArray[np.uint8]
AGENT, BEST, LEARNER = "hoop", "loop", "ppo"
"""The scenarios in motion: an agent's flight against the ghost of the best, and the best flight known; the agent."""
SIZE = (640, 480)
"""Width and height of an animation [px]."""
FRAME, LAST = 40, 1600
"""How long a frame and the last one are seen [ms]."""
SAMPLED = 6
"""Every so many frames the palette is taken from."""
PAPER_FIGURES = ("figure-3", "figure-4", "figure-5")
"""Those of the paper's figures that the README shows."""


def frames(scenario: str, actions: Iterable[Any], *, ghost: bool = False) -> Iterator[Pixels]:
    """Fly actions, each of shape (2,), and yield what the environment renders, before the first and after each."""
    with closing(gym.make("FlatQuad-v0", scenario=scenario, render_mode="rgb_array", ghost=ghost)) as env:
        env.reset(seed=0)
        yield seen(env)
        for action in actions:
            env.step(action)
            yield seen(env)


def seen(env: gym.Env[Any, Any]) -> Pixels:
    """Return what an environment renders."""
    pixels = env.render()
    assert isinstance(pixels, np.ndarray)
    return pixels


def animate(path: Path, flight: Iterable[Pixels], size: tuple[int, int] = SIZE) -> None:
    """Write frames, each of shape (height, width, 3), as a GIF of another size that repeats for ever."""
    shown = [Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS) for pixels in flight]
    sheet = Image.fromarray(np.concatenate([np.asarray(frame) for frame in [*shown[::SAMPLED], shown[-1]]]))
    palette = sheet.quantize(method=Image.Quantize.FASTOCTREE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in shown)
    durations = [FRAME] * len(others) + [LAST]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, lambda part: first.save(part, save_all=True, append_images=others, duration=durations, loop=0))


def flights(folder: Path, benchmark: dict[str, Any]) -> None:
    """Animate the agent's flight in a benchmark's results, and the best flight known of another scenario."""
    agent = np.array(learner(benchmark)["actions"], dtype=np.float32)
    animate(folder / f"{AGENT}.gif", frames(AGENT, agent, ghost=True))
    animate(folder / f"{BEST}.gif", frames(BEST, known(BEST).actions))


def learner(benchmark: dict[str, Any]) -> dict[str, Any]:
    """Return the cell of the agent that is shown."""
    cells = benchmark["cells"]
    found: dict[str, Any] = next(one for one in cells if (one["problem"], one["agent"]) == (AGENT, LEARNER))
    return found


def captions(benchmark: dict[str, Any]) -> str:
    """Return the animations side by side, each with what it shows."""
    cell = learner(benchmark)
    fewest = {name: f"the fewest {'proven' if known(name).proven else 'known'}" for name in (AGENT, BEST)}
    gaps = len(SCENARIOS[BEST].hoops)
    words = {
        AGENT: f"`{AGENT}`: {cell['algorithm']} in {len(cell['actions'])} steps, against the ghost of a flight in "
        f"{known(AGENT).k_star}, {fewest[AGENT]}",
        BEST: f"`{BEST}`: {gaps} gaps in their order, in {known(BEST).k_star} steps, {fewest[BEST]}",
    }
    titles = {AGENT: "An agent's flight through a hoop, and the best one's ghost", BEST: "The best flight of a loop"}
    shown = [f"![{titles[name]}](experiments/results/published/{name}.gif)" for name in words]
    lines = [shown, ["---"] * len(shown), list(words.values())]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def known(scenario: str) -> Reference:
    """Return what is known of a named scenario."""
    found = reference(scenario)
    assert found is not None
    return found


def stills(folder: Path, benchmark: dict[str, Any], paper: dict[str, Any]) -> None:
    """Draw the still figures as SVG; needs the extra `figures` and a Chromium."""
    import optimal
    from experiments import figures
    from experiments.paper import figures as paper_figures

    solution, actions = optimal.solve(AGENT), np.array(learner(benchmark)["actions"], dtype=np.float32)
    tracks = [figures.optimal_track(solution), figures.flown_track(solution.scenario, actions, "PPO")]
    chart = figures.paths(solution.scenario, tracks, f"{AGENT}: the optimum and an agent trained by PPO")
    write_text(folder / f"{AGENT}-paths.svg", chart.to_image("svg", width=1000, height=540).decode())
    for name in PAPER_FIGURES:
        write_text(folder / f"{name}.svg", paper_figures.FIGURES[name]().to_image("svg").decode())
    if rows := paper.get("judged"):
        write_text(folder / "judged.svg", paper_figures.judged(rows).to_image("svg").decode())


def draw(folder: Path, benchmark: dict[str, Any], paper: dict[str, Any]) -> None:
    """Draw all pictures anew, from a benchmark's results and the paper's."""
    flights(folder, benchmark)
    stills(folder, benchmark, paper)
