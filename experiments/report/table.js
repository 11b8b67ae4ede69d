// Tables: a click on a heading sorts, ascending at first; cells without a value stay last. A select filters by task.
"use strict";
(() => {
  const valueOf = (row, column) => row.cells[column].dataset.value;

  function compare(a, b, sign) {
    if (a === "" || b === "") return (a === "") - (b === "");
    const [x, y] = [Number(a), Number(b)];
    const order = Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, "en", { numeric: true }) : x - y;
    return sign * order;
  }

  function sort(table, column) {
    const head = table.tHead.rows[0].cells;
    const ascending = head[column].getAttribute("aria-sort") !== "ascending";
    for (const cell of head) cell.removeAttribute("aria-sort");
    head[column].setAttribute("aria-sort", ascending ? "ascending" : "descending");
    const rows = [...table.tBodies[0].rows];
    rows.sort((a, b) => compare(valueOf(a, column), valueOf(b, column), ascending ? 1 : -1));
    table.tBodies[0].append(...rows);
  }

  for (const table of document.querySelectorAll("table")) {
    [...table.tHead.rows[0].cells].forEach((cell, column) => {
      cell.firstElementChild.addEventListener("click", () => sort(table, column));
    });
  }

  document.getElementById("task").addEventListener("change", (event) => {
    for (const row of document.getElementById("leaderboard").tBodies[0].rows) {
      row.hidden = event.target.value !== "" && valueOf(row, 0) !== event.target.value;
    }
  });
})();
