// Traces: thrust and rate of two race entries over the steps.
"use strict";
const Traces = (() => {
  const { token, prepare, line, COLOURS } = Canvas;
  const PAD = { left: 40, right: 12, top: 18, between: 26, bottom: 20 }; // [px]
  const HEIGHT = 210; // [px]

  // The map from steps to pixels, and back.
  const scale = (width, last) => (width - PAD.left - PAD.right) / last;
  const toStep = (canvas, x, last) => (x - PAD.left) / scale(canvas.clientWidth, last);

  function paint(canvas, world, entries, steps, last) {
    const { draw, width, height } = prepare(canvas, HEIGHT);
    const x = (step) => PAD.left + scale(width, last) * step;
    const tall = (height - PAD.top - PAD.between - PAD.bottom) / 2;
    const now = x(steps);
    [["thrust [m/s²]", world.thrust], ["rate [rad/s]", world.rate]].forEach(([title, limits], which) => {
      const top = PAD.top + which * (tall + PAD.between);
      const y = (value) => top + tall * (1 - (value - limits[0]) / (limits[1] - limits[0]));
      axes(draw, title, limits, y, width);
      entries.forEach((entry, i) => {
        const points = entry.controls.flatMap((control, k) => [[x(k), y(control[which])], [x(k + 1), y(control[which])]]);
        trace(draw, points, token(COLOURS[i]), [0, top - 4, now, tall + 8]);
      });
    });
    draw.strokeStyle = token("--ink");
    draw.lineWidth = 1;
    line(draw, [[now, PAD.top - 4], [now, height - PAD.bottom]]);
    stepLabels(draw, x, last, height);
  }

  // A control over time: strong within the rectangle that time has passed, faint beyond.
  function trace(draw, points, colour, passed) {
    draw.strokeStyle = colour;
    draw.lineWidth = 1.7;
    draw.globalAlpha = 0.28;
    line(draw, points);
    draw.globalAlpha = 1;
    draw.save();
    draw.beginPath();
    draw.rect(...passed);
    draw.clip();
    line(draw, points);
    draw.restore();
  }

  function axes(draw, title, limits, y, width) {
    draw.strokeStyle = token("--outline");
    draw.fillStyle = token("--quiet");
    draw.lineWidth = 1;
    draw.setLineDash([2, 4]);
    draw.textAlign = "end";
    for (const limit of limits) {
      line(draw, [[PAD.left, y(limit)], [width - PAD.right, y(limit)]]);
      draw.fillText(String(limit), PAD.left - 7, y(limit) + 4);
    }
    draw.setLineDash([]);
    draw.textAlign = "start";
    draw.fillText(title, PAD.left, y(limits[1]) - 7);
  }

  function stepLabels(draw, x, last, height) {
    draw.fillStyle = token("--quiet");
    draw.textAlign = "center";
    const every = Math.max(10, 10 * Math.ceil(last / 100));
    for (let step = 0; step <= last; step += every) draw.fillText(String(step), x(step), height - 5);
    draw.textAlign = "start";
  }

  return { paint, toStep };
})();
