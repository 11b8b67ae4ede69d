"""Races replay the environment's episodes, stop at their end, and play by mouse and keyboard."""

import json
import math

import numpy as np
import pytest

from experiments.benchmark.agents import NAMES
from experiments.report import race
from flatgym import SCENARIOS, Quadrotor
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import fly_actions


def test_races_are_episodes_of_the_environment(document, benchmark, evil):
    races = json.loads(document.texts["races"])
    assert races["first"] == "hoop"
    named = {entry["name"]: entry for entry in races["scenarios"]["hoop"]["entries"]}
    assert list(named) == ["best known, K* = 70", evil, "mine", "pretrained policy", "cascaded PD"]
    for name, actions in (
        ("best known, K* = 70", reference("hoop").actions),
        ("mine", benchmark["cells"][-3]["actions"]),
    ):
        flown = fly_actions(SCENARIOS["hoop"], np.array(actions, dtype=np.float32))
        states = np.concatenate([situation.state for situation in flown])
        np.testing.assert_allclose(named[name]["states"], states, atol=0.5001 * 10**-race.DIGITS)
        assert named[name]["steps"] == len(states) - 1 == len(named[name]["controls"])
    assert named[evil]["result"] == "goal in 70 steps, K* = 70, gap 0 %"
    assert named["mine"]["result"] == "flying after 20 steps, K* = 70"
    assert named["mine"]["gap"] is None
    assert named["cascaded PD"]["gap"] == pytest.approx(named["cascaded PD"]["steps"] / 70 - 1)


def test_an_entry_ends_with_its_episode():
    scenario, best = SCENARIOS["ground-6"], reference("ground-6")
    falls = np.full((40, 2), -1.0)
    longer = np.concatenate([best.actions, falls])
    one, other = (race.replay(scenario, "name", actions, best.k_star) for actions in (longer, falls))
    assert (one.outcome, one.steps, one.gap) == ("goal", best.k_star, 0.0)
    assert other.outcome == "floor"
    assert other.steps < 40
    assert "floor after" in other.result()


def test_a_policy_of_ones_own_comes_first_and_is_preselected(benchmark):
    cells = benchmark["cells"]
    ours = [cell for cell in cells if cell["agent"] in NAMES]
    own = [cell for cell in cells if cell["agent"] == "mine" and cell.get("actions")]
    for order in ([*ours, *own], [*own, *ours]):
        hoop = race.races(benchmark | {"cells": order})["scenarios"]["hoop"]
        assert hoop["entries"][hoop["second"]]["name"] == hoop["entries"][1]["name"] == "mine"
    hoop = race.races(benchmark | {"cells": ours})["scenarios"]["hoop"]
    assert hoop["entries"][hoop["second"]]["gap"] > 0


@pytest.mark.parametrize("actions", [[], [[0.0]], [[0.0, math.nan]], [0.0, 0.0]])
def test_actions_that_cannot_be_flown_are_refused(actions):
    with pytest.raises(ValueError, match=r"actions of 'mine' in 'hoop' must be finite, of shape \(K, 2\)"):
        race.replay(SCENARIOS["hoop"], "mine", actions, 70)


def test_a_race_plays_and_scrubs_by_mouse_and_keyboard(tab):
    track, scene = tab.locator("#track"), tab.locator("#scene")

    def time():
        return float(tab.locator("#time").input_value())

    def picture():
        return scene.evaluate("canvas => canvas.toDataURL()")

    assert tab.locator("#result-two").inner_text() == "goal in 70 steps, K* = 70, gap 0 %"  # the external policy
    tab.select_option("#two", label="cascaded PD")
    assert tab.locator("#result-two").inner_text().startswith("goal in 107 steps, K* = 70, gap +52.9 %")
    before = picture()
    tab.keyboard.press("Tab")  # only focus by keyboard is outlined
    scene.focus()
    assert scene.evaluate("canvas => getComputedStyle(canvas).outlineStyle") == "solid"
    tab.keyboard.press("Space")
    tab.wait_for_selector("#play[aria-label=Pause]")
    tab.wait_for_timeout(300)
    tab.keyboard.press("Space")
    assert tab.locator("#play").get_attribute("aria-label") == "Play"
    paused = time()
    assert paused > 0
    assert picture() != before
    tab.wait_for_timeout(100)
    assert time() == paused
    tab.keyboard.press("ArrowRight")
    assert time() == math.floor(paused) + 1
    tab.keyboard.press("Shift+ArrowLeft")
    assert time() == max(0, math.floor(paused) - 9)
    tab.keyboard.press("+")
    tab.keyboard.press("+")
    assert tab.locator("#speed").input_value() == "2"
    tab.keyboard.press("-")
    assert tab.locator("#speed").input_value() == "1"
    tab.locator("#time").fill("80")
    assert tab.locator("#step-one").inner_text() == "step 70 of 70"
    assert tab.locator("#step-two").inner_text() == "step 80 of 107"
    assert track.locator(".ended").count() == 1
    tab.locator("#time").fill("105")
    tab.locator("#play").click()
    tab.wait_for_selector("#play[aria-label=Play]")
    assert "goal in 70 steps" in tab.locator("#status").text_content()
    tab.select_option("#scenario", label="ground-6")
    assert time() == 0
    assert "proven" in tab.locator("#proof").inner_text()
    tab.select_option("#scenario", label="hoop")
    tab.select_option("#two", label="mine")
    assert tab.locator("#result-two").inner_text() == "flying after 20 steps, K* = 70"


def test_between_steps_the_vehicle_follows_the_closed_form(tab):
    generator = np.random.default_rng(0)
    states = generator.normal(size=(40, 5))
    controls = np.column_stack([generator.uniform(1, 20, 40), generator.uniform(-10, 10, 40)])
    durations = np.concatenate([generator.uniform(0, 0.02, 30), generator.uniform(0.1, 0.4, 10)])
    there = tab.evaluate(
        "([states, controls, times]) => states.map((s, i) => Flight.exact(s, controls[i], times[i], 9.81))",
        [states.tolist(), controls.tolist(), durations.tolist()],
    )
    np.testing.assert_allclose(there, Quadrotor().step(states, controls, durations), rtol=0, atol=1e-12)


def test_under_reduced_motion_the_race_shows_its_end_and_jumps(phone):
    phone.emulate_media(reduced_motion="reduce")
    phone.select_option("#scenario", label="ground-6")
    time, last = phone.locator("#time"), reference("ground-6").k_star
    assert float(time.input_value()) == float(time.get_attribute("max")) >= last
    phone.locator("#play").click()
    phone.wait_for_timeout(700)
    phone.locator("#play").click()
    assert 0 < float(time.input_value()) < last
    assert float(time.input_value()) % 5 == 0
