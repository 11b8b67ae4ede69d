// Theme: light or dark, as chosen last, else as the system prefers. Other scripts listen for "themechange".
// It runs in the head, before the first paint.
"use strict";
(() => {
  const root = document.documentElement;
  const preference = matchMedia("(prefers-color-scheme: dark)");
  const KEY = "flatquad-theme";

  // Storage may be forbidden, for local files above all. Then the choice is lost with the page.
  const stored = () => { try { return localStorage.getItem(KEY); } catch { return null; } };
  const store = (theme) => { try { localStorage.setItem(KEY, theme); } catch { /* not stored */ } };
  const current = () => stored() ?? (preference.matches ? "dark" : "light");

  function show(theme) {
    if (root.dataset.theme === theme) return;
    root.dataset.theme = theme;
    labelToggle();
    document.dispatchEvent(new Event("themechange"));
  }

  function labelToggle() {
    const toggle = document.getElementById("theme");
    if (toggle) toggle.textContent = root.dataset.theme === "dark" ? "Light" : "Dark";
  }

  function toggleTheme() {
    const theme = root.dataset.theme === "dark" ? "light" : "dark";
    store(theme);
    show(theme);
  }

  show(current());
  preference.addEventListener("change", () => show(current()));
  addEventListener("DOMContentLoaded", () => {
    labelToggle();
    document.getElementById("theme").addEventListener("click", toggleTheme);
  });

  // Print in the light theme, with all figures open.
  const closed = new Set();
  addEventListener("beforeprint", () => {
    for (const details of document.querySelectorAll("details:not([open])")) { closed.add(details); details.open = true; }
    show("light");
  });
  addEventListener("afterprint", () => {
    for (const details of closed) details.open = false;
    closed.clear();
    show(current());
  });
})();
