// Light or dark: what was chosen last, else what the system wishes. Others listen for "themechange".
// This runs in the head, before anything is painted.
"use strict";
(() => {
  const root = document.documentElement;
  const wish = matchMedia("(prefers-color-scheme: dark)");
  const KEY = "flatquad-theme";

  // Storage may be forbidden, for files above all: then the choice lasts as long as the page.
  const stored = () => { try { return localStorage.getItem(KEY); } catch { return null; } };
  const store = (theme) => { try { localStorage.setItem(KEY, theme); } catch { /* not kept */ } };
  const wanted = () => stored() ?? (wish.matches ? "dark" : "light");

  function show(theme) {
    if (root.dataset.theme === theme) return;
    root.dataset.theme = theme;
    name();
    document.dispatchEvent(new Event("themechange"));
  }

  function name() {
    const toggle = document.getElementById("theme");
    if (toggle) toggle.textContent = root.dataset.theme === "dark" ? "Light" : "Dark";
  }

  function change() {
    const theme = root.dataset.theme === "dark" ? "light" : "dark";
    store(theme);
    show(theme);
  }

  show(wanted());
  wish.addEventListener("change", () => show(wanted()));
  addEventListener("DOMContentLoaded", () => {
    name();
    document.getElementById("theme").addEventListener("click", change);
  });

  // Paper is white, and folded figures would be missing on it.
  const folded = new Set();
  addEventListener("beforeprint", () => {
    for (const fold of document.querySelectorAll("details:not([open])")) { folded.add(fold); fold.open = true; }
    show("light");
  });
  addEventListener("afterprint", () => {
    for (const fold of folded) fold.open = false;
    folded.clear();
    show(wanted());
  });
})();
