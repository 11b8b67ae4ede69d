// Race: the choice of scenario and entries, playback, and the controls by mouse, touch and keyboard.
"use strict";
(() => {
  const JUMP = { steps: 5, pause: 500 }; // playback under reduced motion: steps, and milliseconds between them
  const LONGEST_FRAME = 100; // [ms]; after a longer pause, as of a hidden tab, playback continues where it was

  const { first, scenarios } = JSON.parse(document.getElementById("races").textContent);
  const byId = (id) => document.getElementById(id);
  const [track, scene, traces] = ["track", "scene", "traces"].map(byId);
  const [choice, play, time, clock, speed] = ["scenario", "play", "time", "clock", "speed"].map(byId);
  const selects = [byId("one"), byId("two")];
  const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
  const race = { world: null, entries: [], steps: 0, last: 0, playing: false };

  if (first === null) {
    track.textContent = "No scenario to race in.";
    return;
  }

  // ---- selection ----------------------------------------------------------------------------------------------

  function fill(select, names, selected) {
    select.replaceChildren(...names.map((name, i) => new Option(name, String(i), false, i === selected)));
  }

  function selectScenario(name) {
    race.world = scenarios[name];
    byId("proof").textContent = race.world.proof;
    const names = race.world.entries.map((entry) => entry.name);
    fill(selects[0], names, 0);
    fill(selects[1], names, race.world.second);
    selectEntries();
  }

  const results = () => race.entries.map((entry) => `${entry.name}: ${entry.result}`).join("; ");

  function selectEntries() {
    race.entries = selects.map((select) => race.world.entries[Number(select.value)]);
    race.last = Math.max(...race.entries.map((entry) => entry.steps));
    time.max = String(race.last);
    race.entries.forEach((entry, i) => {
      byId(`name-${selects[i].id}`).textContent = entry.name;
      byId(`result-${selects[i].id}`).textContent = entry.result;
    });
    scene.setAttribute("aria-label", `Race in ${Object.keys(scenarios)[choice.value]}. ${results()}`);
    pause();
    // Under reduced motion the whole episode is shown at once.
    seek(reducedMotion.matches ? race.last : 0);
  }

  // ---- playback -----------------------------------------------------------------------------------------------

  function seek(steps) {
    race.steps = Math.min(Math.max(steps, 0), race.last);
    time.value = String(race.steps);
    const seconds = (race.steps * race.world.dt).toFixed(2);
    clock.textContent = `${seconds} s`;
    time.setAttribute("aria-valuetext", `step ${Math.floor(race.steps)} of ${race.last}, ${seconds} seconds`);
    race.entries.forEach((entry, i) => {
      const { step, ended } = Flight.at(entry, race.steps, race.world);
      const place = byId(`step-${selects[i].id}`);
      place.textContent = `step ${step} of ${entry.steps}`;
      place.closest("div").classList.toggle("ended", ended);
    });
    paint();
  }

  function announce(text) {
    byId("status").textContent = text;
  }

  function pause() {
    race.playing = false;
    play.textContent = "Play";
    play.setAttribute("aria-label", "Play");
  }

  function start() {
    if (race.steps >= race.last) seek(0);
    race.playing = true;
    play.textContent = "Pause";
    play.setAttribute("aria-label", "Pause");
    announce("");
    let before = performance.now();
    requestAnimationFrame(function frame(now) {
      if (!race.playing) return;
      const passed = now - before;
      if (reducedMotion.matches && passed < JUMP.pause) {
        requestAnimationFrame(frame);
        return;
      }
      before = now;
      const steps = Math.min(passed, LONGEST_FRAME) / 1000 * Number(speed.value) / race.world.dt;
      seek(race.steps + (reducedMotion.matches ? JUMP.steps : Math.max(steps, 0)));
      if (race.steps < race.last) requestAnimationFrame(frame);
      else finish();
    });
  }

  function finish() {
    pause();
    announce(results());
  }

  const toggle = () => (race.playing ? pause() : start());

  function changeSpeed(by) {
    const wanted = speed.selectedIndex + by;
    speed.selectedIndex = Math.min(Math.max(wanted, 0), speed.options.length - 1);
    announce(`Speed ${speed.value}`);
  }

  function paint() {
    Scene.paint(scene, race.world, race.entries, race.steps);
    Traces.paint(traces, race.world, race.entries, race.steps, race.last);
  }

  // ---- controls -----------------------------------------------------------------------------------------------

  function onKey(event) {
    // From the step that is displayed: race.steps may be just below it.
    const step = event.shiftKey ? 10 : 1, shown = Number(time.value);
    const actions = {
      " ": toggle,
      ArrowLeft: () => { pause(); seek(Math.ceil(shown) - step); },
      ArrowRight: () => { pause(); seek(Math.floor(shown) + step); },
      "+": () => changeSpeed(1),
      "=": () => changeSpeed(1),
      "-": () => changeSpeed(-1),
      "_": () => changeSpeed(-1),
    };
    const action = actions[event.key];
    // Selects and buttons handle space and arrows themselves.
    const handled = event.target.matches("select, button") && !["+", "=", "-", "_"].includes(event.key);
    if (!action || handled || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action();
  }

  function scrub(event) {
    if (event.type === "pointermove" && !event.buttons) return;
    pause();
    seek(Traces.toStep(traces, event.offsetX, race.last));
  }

  const names = Object.keys(scenarios);
  fill(choice, names, names.indexOf(first));
  choice.addEventListener("change", () => selectScenario(names[choice.value]));
  for (const select of selects) select.addEventListener("change", selectEntries);
  play.addEventListener("click", toggle);
  scene.addEventListener("click", toggle);
  time.addEventListener("input", () => { pause(); seek(Number(time.value)); });
  traces.addEventListener("pointerdown", scrub);
  traces.addEventListener("pointermove", scrub);
  track.addEventListener("keydown", onKey);
  document.addEventListener("themechange", paint);
  new ResizeObserver(paint).observe(track);
  selectScenario(first);
})();
