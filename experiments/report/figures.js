// Figures: Plotly is decompressed after the page is visible. Figures near the viewport are drawn at once, the others one
// by one while the page is idle, so that a picture of the whole page has them.
"use strict";
(() => {
  const { dark, charts } = JSON.parse(document.getElementById("figures").textContent);
  const NARROW = 520; // width below which the font is smaller [px]
  const places = [...document.querySelectorAll(".chart")];
  const near = new Set();
  let ready = false;

  const isDark = () => document.documentElement.dataset.theme === "dark";
  const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function heightOf(place, chart) {
    const natural = chart.aspect * place.clientWidth;
    return chart.aspect ? Math.max(220, Math.min(chart.height, natural)) : chart.height;
  }

  // A copy of a value with the colours of the light theme replaced by those of the dark theme.
  function darkened(value) {
    if (typeof value === "string") return dark[value] ?? value;
    if (Array.isArray(value)) return value.map(darkened);
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, darkened(inner)]));
    }
    return value;
  }

  function styled(place, chart) {
    const figure = isDark() ? darkened(chart.figure) : structuredClone(chart.figure);
    const narrow = place.clientWidth < NARROW;
    const axis = {
      gridcolor: token("--faint"), linecolor: token("--outline"), title: { standoff: 8 },
      automargin: true, ticks: "outside", ticklen: 4, tickcolor: token("--faint"), fixedrange: matchMedia("(pointer: coarse)").matches,
    };
    const base = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: narrow ? 11 : 13, color: token("--ink") },
      hoverlabel: { bgcolor: token("--raised"), font: { color: token("--ink") } },
      xaxis: axis, yaxis: axis,
    };
    const margin = { l: narrow ? 44 : 56, r: narrow ? 10 : 18, t: 30, b: 46 };
    const layout = { margin, ...figure.layout, template: { layout: base }, height: heightOf(place, chart) };
    return [figure.data, layout];
  }

  const config = { displaylogo: false, displayModeBar: false };
  function draw(place) {
    const [data, layout] = styled(place, charts[place.id]);
    Plotly.react(place, data, layout, config);
  }

  // Reserve the height of each figure, so that the page does not jump when it is drawn.
  for (const place of places) {
    const chart = charts[place.id];
    if (chart.min_width) place.style.minWidth = `${chart.min_width}px`;
    place.style.minHeight = `${heightOf(place, chart)}px`;
  }

  const watch = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting) continue;
      watch.unobserve(target);
      near.add(target);
      if (ready) draw(target);
    }
  }, { rootMargin: "600px" });
  places.forEach((place) => watch.observe(place));

  // Plotly's own resizing would keep height and font.
  const widths = new Map();
  const resized = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      if (widths.get(target) === contentRect.width || !contentRect.width) continue;
      const first = !widths.has(target);
      widths.set(target, contentRect.width);
      target.style.minHeight = `${heightOf(target, charts[target.id])}px`;
      if (!first && ready && near.has(target)) draw(target);
    }
  });
  places.forEach((place) => resized.observe(place));

  function drawAll() {
    if (ready) near.forEach(draw);
  }
  document.addEventListener("themechange", drawAll);
  addEventListener("beforeprint", () => {
    places.forEach((place) => near.add(place));
    drawAll();
  });

  function drawRest() {
    const next = places.find((place) => !near.has(place) && place.clientWidth); // closed parts have no width
    if (!next) {
      document.documentElement.dataset.figures = "drawn";
      return;
    }
    watch.unobserve(next);
    near.add(next);
    draw(next);
    idle(drawRest);
  }

  async function decompressed(text) {
    const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }

  async function load() {
    const packed = document.getElementById("plotly");
    const script = document.createElement("script");
    script.textContent = await decompressed(packed.textContent);
    packed.remove();
    document.head.append(script);
    ready = true;
    drawAll();
    idle(drawRest);
  }

  function fail(error) {
    for (const place of places) place.textContent = `Figures could not be drawn: ${error}`;
  }

  const idle = window.requestIdleCallback ?? ((work) => setTimeout(work, 50));
  const afterPaint = (work) => requestAnimationFrame(() => requestAnimationFrame(() => idle(work)));
  addEventListener("load", () => afterPaint(() => load().catch(fail)));
})();
