// Canvas: what both canvases of the race share.
"use strict";
const Canvas = (() => {
  const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  // Match the canvas to the pixels of the screen; return a context that draws in CSS pixels.
  function prepare(canvas, height) {
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

  function line(draw, points) {
    draw.beginPath();
    points.forEach(([x, y], i) => (i ? draw.lineTo(x, y) : draw.moveTo(x, y)));
    draw.stroke();
  }

  return { token, prepare, line, COLOURS: ["--one", "--two"] };
})();
