// Scene: a scenario on a canvas, with the paths and vehicles of two race entries at one time.
"use strict";
const Scene = (() => {
  const { token, prepare, line, COLOURS } = Canvas;
  const ARM = 0.18; // half the width of the vehicle [m]
  const THRUST_LENGTH = 0.02; // length of the drawn thrust for each unit of it [m / (m/s^2)]
  const POST = 0.45; // length of the drawn posts of a hoop [m]
  const MARGIN = 0.4; // around everything that is drawn [m]
  const LABEL_SPACE = { x: 24, y: 60 }; // for labels beyond the margin: left plus right, above plus below [px]
  const GHOST_STEPS = 10; // steps between the vehicles drawn along a path

  // The rectangle to show [m]: both paths and all hoops.
  function extent({ hoops, start, goal }, entries) {
    const points = [start, goal, ...entries.flatMap((entry) => entry.states)];
    for (const [x, z, d] of hoops) points.push([x - d, z - d], [x + d, z + d]);
    const [xs, zs] = [points.map((p) => p[0]), points.map((p) => p[1])];
    return {
      left: Math.min(...xs) - MARGIN, right: Math.max(...xs) + MARGIN,
      low: Math.min(...zs) - MARGIN, high: Math.max(...zs) + MARGIN,
    };
  }

  // The scale [px/m] and the map from metres to pixels.
  function camera(canvas, { left, right, low, high }) {
    const width = canvas.clientWidth;
    const natural = (width - LABEL_SPACE.x) * (high - low) / (right - left) + LABEL_SPACE.y;
    const most = Math.max(260, Math.min(480, innerHeight * 0.6));
    const height = Math.round(Math.min(Math.max(natural, 200), most));
    const scale = Math.min((width - LABEL_SPACE.x) / (right - left), (height - LABEL_SPACE.y) / (high - low));
    const [x0, z0] = [width / 2 - scale * (left + right) / 2, height / 2 + scale * (low + high) / 2];
    return { width, height, scale, to: ([x, z]) => [x0 + scale * x, z0 - scale * z] };
  }

  function paint(canvas, world, entries, steps) {
    const view = camera(canvas, extent(world, entries));
    const { draw } = prepare(canvas, view.height);
    heightLimits(draw, view, world);
    scaleBar(draw, view);
    hoops(draw, view, world.hoops);
    hoopNumbers(draw, view, world.hoops);
    startAndGoal(draw, view, world);
    entries.forEach((entry, i) => trail(draw, view, world, entry, steps, COLOURS[i]));
    // The first entry is drawn on top.
    for (const i of [1, 0]) vehicle(draw, view, Flight.at(entries[i], steps, world), COLOURS[i], 1);
  }

  function trail(draw, view, world, entry, steps, colour) {
    draw.strokeStyle = token(colour);
    draw.lineWidth = 1;
    draw.globalAlpha = 0.35;
    draw.setLineDash([2, 5]);
    line(draw, Flight.path(entry, entry.steps, world).map(view.to));
    draw.setLineDash([]);
    draw.globalAlpha = 1;
    draw.lineWidth = 2.2;
    line(draw, Flight.path(entry, steps, world).map(view.to));
    for (let step = 0; step < Math.min(steps, entry.steps); step += GHOST_STEPS) {
      vehicle(draw, view, Flight.at(entry, step, world), colour, 0.3);
    }
  }

  function heightLimits(draw, view, { floor, ceiling }) {
    for (const [level, outwards] of [[floor, 1], [ceiling, -1]]) {
      if (level === null) continue;
      const y = view.to([0, level])[1];
      draw.fillStyle = token("--faint");
      draw.fillRect(0, outwards > 0 ? y : 0, view.width, outwards > 0 ? view.height - y : y);
      draw.strokeStyle = token("--ink");
      draw.lineWidth = 1.5;
      line(draw, [[0, y], [view.width, y]]);
    }
  }

  function scaleBar(draw, view) {
    const [x, y] = [view.width - 12 - view.scale, view.height - 12];
    draw.strokeStyle = token("--outline");
    draw.fillStyle = token("--quiet");
    draw.lineWidth = 2;
    line(draw, [[x, y], [x + view.scale, y]]);
    draw.fillText("1 m", x, y - 7);
  }

  // The posts on both sides of each gap.
  function hoops(draw, view, list) {
    draw.strokeStyle = token("--ink");
    draw.lineWidth = 5;
    draw.lineCap = "butt";
    list.forEach(([x, z, diameter, angle]) => {
      const across = [-Math.sin(angle), Math.cos(angle)];
      const on = (length) => view.to([x + length * across[0], z + length * across[1]]);
      for (const side of [-1, 1]) line(draw, [on(side * diameter / 2), on(side * (diameter / 2 + POST))]);
    });
    draw.lineCap = "round";
  }

  // The order of the hoops, beyond their posts. A hoop that is passed twice has two numbers.
  function hoopNumbers(draw, view, list) {
    if (list.length < 2) return;
    const numbers = new Map();
    list.forEach((hoop, i) => numbers.set(String(hoop), [...numbers.get(String(hoop)) ?? [], i + 1]));
    draw.fillStyle = token("--quiet");
    draw.textAlign = "center";
    for (const [x, z, diameter, angle] of new Map(list.map((hoop) => [String(hoop), hoop])).values()) {
      const beyond = diameter / 2 + POST + 14 / view.scale;
      const [u, v] = view.to([x - Math.sin(angle) * beyond, z + Math.cos(angle) * beyond]);
      draw.fillText(numbers.get(String([x, z, diameter, angle])).join(", "), u, v + 4);
    }
    draw.textAlign = "start";
  }

  function startAndGoal(draw, view, { start, goal, tolerance }) {
    draw.lineWidth = 2;
    draw.strokeStyle = token("--flame");
    draw.fillStyle = token("--quiet");
    draw.textAlign = "center";
    for (const [name, point, radius] of [["start", start, 5], ["goal", goal, Math.max(5, tolerance * view.scale)]]) {
      const [x, y] = view.to(point);
      draw.beginPath();
      draw.arc(x, y, radius, 0, 2 * Math.PI);
      draw.stroke();
      draw.fillText(name, x, y + 28);
    }
    draw.textAlign = "start";
  }

  // The paper's symbol of the vehicle: an arm with two rotors, and a line along the thrust.
  function vehicle(draw, view, { state, control }, colour, alpha) {
    const arm = Math.max(ARM * view.scale, 11);
    const [cos, sin] = [Math.cos(state[4]), Math.sin(state[4])];
    const [x, y] = view.to(state);
    // A point in pixels, along the arm and along the thrust. Theta is clockwise from the vertical.
    const on = (along, up) => [x + along * cos + up * sin, y + along * sin - up * cos];
    draw.globalAlpha = alpha;
    if (alpha === 1) {
      draw.strokeStyle = token("--flame");
      draw.lineWidth = 2.2;
      line(draw, [on(0, 0), on(0, THRUST_LENGTH * control[0] * arm / ARM)]);
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

  return { paint };
})();
