// The race: two flights of a scenario on one canvas, their thrust and rate on another, all at one time.
"use strict";
(() => {
  const ARM = 0.18; // half the width of the vehicle [m]
  const THRUST = 0.02; // length of the thrust's line for each unit of it [m / (m/s^2)]
  const ROOM = 0.4; // around everything that is drawn [m]
  const EDGE = { x: 24, y: 60 }; // and beyond that, for words: left and right together, above and below together [px]
  const EVERY = 10; // steps between the vehicles left on a trail
  const JUMP = { steps: 5, pause: 500 }; // how it moves where motion is to be reduced; pause in [ms]
  const COLOURS = ["--one", "--two"];

  const { first, scenarios } = JSON.parse(document.getElementById("races").textContent);
  const byId = (id) => document.getElementById(id);
  const [track, scene, traces] = ["track", "scene", "traces"].map(byId);
  const [choice, play, time, clock, speed] = ["scenario", "play", "time", "clock", "speed"].map(byId);
  const picks = [byId("one"), byId("two")];
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const race = { world: null, flights: [], steps: 0, last: 0, playing: false };

  if (first === null) {
    track.textContent = "There is no scenario to race in.";
    return;
  }

  // ---- what is chosen -----------------------------------------------------------------------------------------

  function fill(select, names, chosen) {
    select.replaceChildren(...names.map((name, i) => new Option(name, String(i), false, i === chosen)));
  }

  function enter(name) {
    race.world = scenarios[name];
    byId("known").textContent = race.world.known;
    const names = race.world.flights.map((flight) => flight.name);
    fill(picks[0], names, 0);
    fill(picks[1], names, race.world.rival);
    pair();
  }

  function pair() {
    race.flights = picks.map((pick) => race.world.flights[Number(pick.value)]);
    race.last = Math.max(...race.flights.map((flight) => flight.steps));
    time.max = String(race.last);
    race.flights.forEach((flight, i) => {
      byId(`name-${picks[i].id}`).textContent = flight.name;
      byId(`told-${picks[i].id}`).textContent = flight.told;
    });
    const words = race.flights.map((flight) => `${flight.name}: ${flight.told}`).join("; ");
    scene.setAttribute("aria-label", `Race in ${Object.keys(scenarios)[choice.value]}. ${words}`);
    pause();
    // Where motion is to be reduced, the whole flight is shown at once.
    seek(still.matches ? race.last : 0);
  }

  // ---- time ---------------------------------------------------------------------------------------------------

  function seek(steps) {
    race.steps = Math.min(Math.max(steps, 0), race.last);
    time.value = String(race.steps);
    const seconds = (race.steps * race.world.dt).toFixed(2);
    clock.textContent = `${seconds} s`;
    time.setAttribute("aria-valuetext", `step ${Math.floor(race.steps)} of ${race.last}, ${seconds} seconds`);
    race.flights.forEach((flight, i) => {
      const { step, ended } = Flight.at(flight, race.steps, race.world);
      const place = byId(`step-${picks[i].id}`);
      place.textContent = `step ${step} of ${flight.steps}`;
      place.closest("div").classList.toggle("ended", ended);
    });
    paint();
  }

  function say(words) {
    byId("said").textContent = words;
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
    say("");
    let before = performance.now();
    requestAnimationFrame(function tick(now) {
      if (!race.playing) return;
      const passed = now - before;
      if (still.matches && passed < JUMP.pause) {
        requestAnimationFrame(tick);
        return;
      }
      before = now;
      const flown = Math.min(passed, 100) / 1000 * Number(speed.value) / race.world.dt;
      seek(race.steps + (still.matches ? JUMP.steps : Math.max(flown, 0)));
      if (race.steps < race.last) requestAnimationFrame(tick);
      else finish();
    });
  }

  function finish() {
    pause();
    say(race.flights.map((flight) => `${flight.name}: ${flight.told}`).join("; "));
  }

  const toggle = () => (race.playing ? pause() : start());

  function faster(by) {
    const wanted = speed.selectedIndex + by;
    speed.selectedIndex = Math.min(Math.max(wanted, 0), speed.options.length - 1);
    say(`Speed ${speed.value}`);
  }

  // ---- painting -----------------------------------------------------------------------------------------------

  // A canvas of as many pixels as the screen has; returns what to draw with, in CSS pixels.
  function pen(canvas, height) {
    const ratio = devicePixelRatio || 1;
    const width = canvas.clientWidth;
    if (canvas.style.height !== `${height}px`) canvas.style.height = `${height}px`;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const draw = canvas.getContext("2d");
    draw.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw.clearRect(0, 0, width, height);
    draw.font = "12px system-ui, sans-serif";
    draw.lineCap = "round";
    draw.lineJoin = "round";
    return { draw, width, height };
  }

  // What has to be seen [m]: both flights and all hoops.
  function extent({ hoops, start, goal }, flights) {
    const points = [start, goal, ...flights.flatMap((flight) => flight.states)];
    for (const [x, z, d] of hoops) points.push([x - d, z - d], [x + d, z + d]);
    const [xs, zs] = [points.map((p) => p[0]), points.map((p) => p[1])];
    return {
      left: Math.min(...xs) - ROOM, right: Math.max(...xs) + ROOM,
      low: Math.min(...zs) - ROOM, high: Math.max(...zs) + ROOM,
    };
  }

  function camera({ left, right, low, high }) {
    const width = scene.clientWidth;
    const natural = (width - EDGE.x) * (high - low) / (right - left) + EDGE.y;
    const most = Math.max(260, Math.min(480, innerHeight * 0.6));
    const height = Math.round(Math.min(Math.max(natural, 200), most));
    const scale = Math.min((width - EDGE.x) / (right - left), (height - EDGE.y) / (high - low));
    const [x0, z0] = [width / 2 - scale * (left + right) / 2, height / 2 + scale * (low + high) / 2];
    return { width, height, scale, to: ([x, z]) => [x0 + scale * x, z0 - scale * z] };
  }

  function line(draw, points) {
    draw.beginPath();
    points.forEach(([x, y], i) => (i ? draw.lineTo(x, y) : draw.moveTo(x, y)));
    draw.stroke();
  }

  function paintScene() {
    const { world, flights } = race;
    const view = camera(extent(world, flights));
    const { draw } = pen(scene, view.height);
    scenery(draw, view, world);
    flights.forEach((flight, i) => {
      draw.strokeStyle = token(COLOURS[i]);
      draw.lineWidth = 1;
      draw.globalAlpha = 0.35;
      draw.setLineDash([2, 5]);
      line(draw, Flight.path(flight, flight.steps, world).map(view.to));
      draw.setLineDash([]);
      draw.globalAlpha = 1;
      draw.lineWidth = 2.2;
      line(draw, Flight.path(flight, race.steps, world).map(view.to));
      for (let step = 0; step < Math.min(race.steps, flight.steps); step += EVERY) {
        vehicle(draw, view, Flight.at(flight, step, world), COLOURS[i], 0.3);
      }
    });
    // The first lies on top, where both fly alike.
    for (const i of [1, 0]) vehicle(draw, view, Flight.at(flights[i], race.steps, world), COLOURS[i], 1);
  }

  function scenery(draw, view, { floor, ceiling, hoops, start, goal, tolerance }) {
    const [ink, faint, flame] = ["--ink", "--faint", "--flame"].map(token);
    for (const [level, outwards] of [[floor, 1], [ceiling, -1]]) {
      if (level === null) continue;
      const y = view.to([0, level])[1];
      draw.fillStyle = faint;
      draw.fillRect(0, outwards > 0 ? y : 0, view.width, outwards > 0 ? view.height - y : y);
      draw.strokeStyle = ink;
      draw.lineWidth = 1.5;
      line(draw, [[0, y], [view.width, y]]);
    }
    scaleBar(draw, view);
    draw.strokeStyle = ink;
    draw.lineWidth = 5;
    draw.lineCap = "butt";
    hoops.forEach(([x, z, diameter, angle]) => {
      const across = [-Math.sin(angle), Math.cos(angle)];
      const on = (length) => view.to([x + length * across[0], z + length * across[1]]);
      for (const side of [-1, 1]) line(draw, [on(side * diameter / 2), on(side * (diameter / 2 + 0.45))]);
    });
    numbersOf(draw, view, hoops);
    draw.lineCap = "round";
    draw.lineWidth = 2;
    draw.strokeStyle = flame;
    for (const [name, point, radius] of [["start", start, 5], ["goal", goal, Math.max(5, tolerance * view.scale)]]) {
      const [x, y] = view.to(point);
      draw.beginPath();
      draw.arc(x, y, radius, 0, 2 * Math.PI);
      draw.stroke();
      draw.fillStyle = token("--quiet");
      draw.textAlign = "center";
      draw.fillText(name, x, y + 28);
      draw.textAlign = "start";
    }
  }

  // Which hoop is which, beyond its post; one that is passed twice has two numbers.
  function numbersOf(draw, view, hoops) {
    if (hoops.length < 2) return;
    const numbers = new Map();
    hoops.forEach((hoop, i) => numbers.set(String(hoop), [...numbers.get(String(hoop)) ?? [], i + 1]));
    draw.fillStyle = token("--quiet");
    draw.textAlign = "center";
    for (const [x, z, diameter, angle] of new Map(hoops.map((hoop) => [String(hoop), hoop])).values()) {
      const beyond = diameter / 2 + 0.45 + 14 / view.scale;
      const [u, v] = view.to([x - Math.sin(angle) * beyond, z + Math.cos(angle) * beyond]);
      draw.fillText(numbers.get(String([x, z, diameter, angle])).join(", "), u, v + 4);
    }
    draw.textAlign = "start";
  }

  function scaleBar(draw, view) {
    const [x, y] = [12, view.height - 12];
    draw.strokeStyle = token("--outline");
    draw.fillStyle = token("--quiet");
    draw.lineWidth = 2;
    line(draw, [[x, y], [x + view.scale, y]]);
    draw.fillText("1 m", x, y - 7);
  }

  // The paper's glyph: an arm with two rotors, and the line along which the thrust pushes.
  function vehicle(draw, view, { state, control }, colour, alpha) {
    const arm = Math.max(ARM * view.scale, 11);
    const [cos, sin] = [Math.cos(state[4]), Math.sin(state[4])];
    const [x, y] = view.to(state);
    // Along the arm and up the mast, in pixels; theta turns clockwise, from the vertical.
    const on = (along, up) => [x + along * cos + up * sin, y + along * sin - up * cos];
    draw.globalAlpha = alpha;
    if (alpha === 1) {
      draw.strokeStyle = token("--flame");
      draw.lineWidth = 2.2;
      line(draw, [on(0, 0), on(0, THRUST * control[0] * arm / ARM)]);
    }
    draw.strokeStyle = token(colour);
    draw.lineWidth = alpha === 1 ? 2.6 : 1.4;
    line(draw, [on(-arm, 0), on(arm, 0)]);
    for (const side of [-arm, arm]) {
      line(draw, [on(side, 0), on(side, 0.3 * arm)]);
      line(draw, [on(side - 0.5 * arm, 0.3 * arm), on(side + 0.5 * arm, 0.3 * arm)]);
    }
    draw.globalAlpha = 1;
  }

  // ---- thrust and rate ----------------------------------------------------------------------------------------

  const PAD = { left: 40, right: 12, top: 18, between: 26, bottom: 20 };
  const onTraces = (width) => (steps) => PAD.left + (width - PAD.left - PAD.right) * steps / race.last;

  function paintTraces() {
    const { draw, width, height } = pen(traces, 210);
    const x = onTraces(width);
    const tall = (height - PAD.top - PAD.between - PAD.bottom) / 2;
    const now = x(race.steps);
    [["thrust [m/s²]", race.world.thrust], ["rate [rad/s]", race.world.rate]].forEach(([title, limits], which) => {
      const top = PAD.top + which * (tall + PAD.between);
      const y = (value) => top + tall * (1 - (value - limits[0]) / (limits[1] - limits[0]));
      panel(draw, title, limits, y, width);
      race.flights.forEach((flight, i) => {
        const held = flight.controls.flatMap((control, k) => [[x(k), y(control[which])], [x(k + 1), y(control[which])]]);
        draw.strokeStyle = token(COLOURS[i]);
        draw.lineWidth = 1.7;
        draw.globalAlpha = 0.28;
        line(draw, held);
        draw.globalAlpha = 1;
        draw.save();
        draw.beginPath();
        draw.rect(0, top - 4, now, tall + 8);
        draw.clip();
        line(draw, held);
        draw.restore();
      });
    });
    draw.strokeStyle = token("--ink");
    draw.lineWidth = 1;
    line(draw, [[now, PAD.top - 4], [now, height - PAD.bottom]]);
    draw.fillStyle = token("--quiet");
    draw.textAlign = "center";
    const every = Math.max(10, 10 * Math.ceil(race.last / 100));
    for (let step = 0; step <= race.last; step += every) draw.fillText(String(step), x(step), height - 5);
    draw.textAlign = "start";
  }

  function panel(draw, title, limits, y, width) {
    draw.strokeStyle = token("--outline");
    draw.fillStyle = token("--quiet");
    draw.lineWidth = 1;
    draw.setLineDash([2, 4]);
    for (const limit of limits) {
      line(draw, [[PAD.left, y(limit)], [width - PAD.right, y(limit)]]);
      draw.textAlign = "end";
      draw.fillText(String(limit), PAD.left - 7, y(limit) + 4);
    }
    draw.setLineDash([]);
    draw.textAlign = "start";
    draw.fillText(title, PAD.left, y(limits[1]) - 7);
  }

  function paint() {
    paintScene();
    paintTraces();
  }

  // ---- hands on -----------------------------------------------------------------------------------------------

  function keys(event) {
    const step = event.shiftKey ? 10 : 1;
    const actions = {
      " ": toggle,
      ArrowLeft: () => { pause(); seek(Math.ceil(race.steps) - step); },
      ArrowRight: () => { pause(); seek(Math.floor(race.steps) + step); },
      "+": () => faster(1),
      "=": () => faster(1),
      "-": () => faster(-1),
      "_": () => faster(-1),
    };
    const action = actions[event.key];
    const own = event.target.matches("select, button") && !["+", "=", "-", "_"].includes(event.key);
    if (!action || own || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action();
  }

  function scrub(event) {
    if (event.type === "pointermove" && !event.buttons) return;
    const [from, to] = [onTraces(traces.clientWidth)(0), onTraces(traces.clientWidth)(race.last)];
    pause();
    seek((event.offsetX - from) / (to - from) * race.last);
  }

  const names = Object.keys(scenarios);
  fill(choice, names, names.indexOf(first));
  choice.addEventListener("change", () => enter(names[choice.value]));
  for (const pick of picks) pick.addEventListener("change", pair);
  play.addEventListener("click", toggle);
  scene.addEventListener("click", toggle);
  time.addEventListener("input", () => { pause(); seek(Number(time.value)); });
  traces.addEventListener("pointerdown", scrub);
  traces.addEventListener("pointermove", scrub);
  track.addEventListener("keydown", keys);
  document.addEventListener("themechange", paint);
  new ResizeObserver(paint).observe(track);
  enter(first);
})();
