"""Pictures of README and docs: animations drawn by the environment, and still figures as SVG.

An animation shows a flight at half speed, one frame a step. All frames share one palette, so that pixels at rest in the
flight do not flicker.
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

from experiments.files import Row
from flatgym import SCENARIOS
from flatgym.files import write_text, write_whole
from flatgym.scenarios.reference import Reference, reference

Pixels = NDArray[np.uint8]
AGENT, BEST, LEARNER = "hoop", "loop", "ppo"
"""Scenario of the animated agent, scenario of the animated best-known flight, and the agent."""
TITLES = {AGENT: "The flight of an agent through a hoop, with the ghost of the optimum", BEST: "The best-known loop"}
SIZE = (640, 480)
"""Width and height of an animation [px]."""
FRAME_TIME, LAST_FRAME_TIME = 40, 1600
"""Duration of a frame and of the last one [ms]."""
PALETTE_STRIDE = 6
"""The palette is computed from every sixth frame."""
PAPER_FIGURES = ("figure-3", "figure-4", "figure-5")
"""The paper's figures that the docs show."""


def frames(scenario: str, actions: Iterable[Any], *, ghost: bool = False) -> Iterator[Pixels]:
    """Yield what the environment renders before the first and after each of the actions, each of shape (2,)."""
    with closing(gym.make("FlatQuad-v0", scenario=scenario, render_mode="rgb_array", ghost=ghost)) as env:
        env.reset(seed=0)
        yield rendered(env)
        for action in actions:
            env.step(action)
            yield rendered(env)


def rendered(env: gym.Env[Any, Any]) -> Pixels:
    """Return the picture of an environment, shape (height, width, 3)."""
    pixels = env.render()
    assert isinstance(pixels, np.ndarray)
    return pixels


def animate(path: Path, flight: Iterable[Pixels], size: tuple[int, int] = SIZE) -> None:
    """Write frames, each of shape (height, width, 3), as an endless GIF of another size."""
    scaled = [Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS) for pixels in flight]
    sample = Image.fromarray(np.concatenate([np.asarray(frame) for frame in [*scaled[::PALETTE_STRIDE], scaled[-1]]]))
    palette = sample.quantize(method=Image.Quantize.FASTOCTREE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in scaled)
    durations = [FRAME_TIME] * len(others) + [LAST_FRAME_TIME]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, lambda part: first.save(part, save_all=True, append_images=others, duration=durations, loop=0))


def animations(folder: Path, benchmark: Row) -> None:
    """Animate the agent's flight in a benchmark's results, and the best-known flight of another scenario."""
    agent = np.array(agent_cell(benchmark)["actions"], dtype=np.float32)
    animate(folder / f"{AGENT}.gif", frames(AGENT, agent, ghost=True))
    animate(folder / f"{BEST}.gif", frames(BEST, known(BEST).actions))


def agent_cell(benchmark: Row) -> Row:
    """Return the cell of the animated agent."""
    found: Row = next(cell for cell in benchmark["cells"] if (cell["problem"], cell["agent"]) == (AGENT, LEARNER))
    return found


def sentences(benchmark: Row) -> dict[str, str]:
    """Return what each animation shows, with its number of steps."""
    cell = agent_cell(benchmark)
    fewest = {name: "proven optimal" if known(name).proven else "the best known" for name in (AGENT, BEST)}
    return {
        AGENT: f"`{AGENT}`: {cell['algorithm']} in {len(cell['actions'])} steps, and the ghost of a flight in "
        f"{known(AGENT).k_star} steps, {fewest[AGENT]}",
        BEST: f"`{BEST}`: {len(SCENARIOS[BEST].hoops)} gaps in order, in {known(BEST).k_star} steps, {fewest[BEST]}",
    }


def caption(benchmark: Row) -> str:
    """Return the animation of the agent with a caption, as Markdown."""
    return f"{image(AGENT)}\n\n{sentences(benchmark)[AGENT]}, at half speed."


def captions(benchmark: Row) -> str:
    """Return both animations side by side with captions, as Markdown."""
    found = sentences(benchmark)
    lines = [[image(name) for name in found], ["---"] * len(found), list(found.values())]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def image(name: str) -> str:
    """Return an animation as Markdown."""
    return f"![{TITLES[name]}](experiments/results/published/{name}.gif)"


def known(scenario: str) -> Reference:
    """Return the best-known solution of a named scenario."""
    found = reference(scenario)
    assert found is not None
    return found


def stills(folder: Path, benchmark: Row, paper: Row) -> None:
    """Draw the still figures as SVG; needs the extra `figures` and a Chromium."""
    import optimal
    from experiments import figures
    from experiments.paper import figures as paper_figures

    solution, actions = optimal.solve(AGENT), np.array(agent_cell(benchmark)["actions"], dtype=np.float32)
    tracks = [figures.optimal_track(solution), figures.replayed_track(solution.scenario, actions, "PPO")]
    chart = figures.paths(solution.scenario, tracks, f"{AGENT}: the optimum and an agent trained by PPO")
    write_text(folder / f"{AGENT}-paths.svg", chart.to_image("svg", width=1000, height=540).decode())
    for name in PAPER_FIGURES:
        write_text(folder / f"{name}.svg", paper_figures.FIGURES[name]().to_image("svg").decode())
    if rows := paper.get("verdicts"):
        write_text(folder / "verdicts.svg", paper_figures.verdict_figure(rows).to_image("svg").decode())


def draw(folder: Path, benchmark: Row, paper: Row) -> None:
    """Draw all pictures of a benchmark's results and the paper's."""
    animations(folder, benchmark)
    stills(folder, benchmark, paper)
