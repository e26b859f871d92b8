/* Sorting and filtering of the tables of deviations; without it the page shows all rows in their order. */
(() => {
  "use strict";
  const number = (text) => {
    const found = text.replace(/\u2212/g, "-").match(/[-+]?\d+(\.\d+)?(e[-+]?\d+)?/);
    return found ? Number(found[0]) : NaN;
  };
  const inOrder = (one, other, up) => {
    if (Number.isNaN(one) || Number.isNaN(other)) return Number.isNaN(one) - Number.isNaN(other); // unknown ones last
    return (one < other ? -1 : one > other ? 1 : 0) * (up ? 1 : -1);
  };

  for (const table of document.querySelectorAll("table.results")) {
    const heads = [...table.tHead.rows[0].cells];
    const asWritten = [...table.tBodies[0].rows];
    heads.forEach((head, column) => {
      if (head.classList.contains("scale")) return;
      const button = document.createElement("button");
      button.type = "button";
      button.title = "Sort by this column";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const next = { ascending: "descending", descending: "none" }[head.getAttribute("aria-sort")] ?? "ascending";
        heads.forEach((each) => each.removeAttribute("aria-sort"));
        if (next !== "none") head.setAttribute("aria-sort", next);
        const key = (row) => {
          const text = row.cells[column].textContent.trim();
          return head.classList.contains("num") ? number(text) : text.toLowerCase();
        };
        const rows = [...asWritten];
        if (next !== "none") rows.sort((one, other) => inOrder(key(one), key(other), next === "ascending"));
        table.tBodies[0].append(...rows);
      });
    });
  }

  for (const place of document.querySelectorAll("[data-filter]")) {
    const rows = [...place.parentElement.querySelector("table.results").tBodies[0].rows];
    const said = document.createElement("span");
    const choices = ["rig", "verdict"].map((name) => {
      const choice = document.createElement("select");
      choice.setAttribute("aria-label", `Show one ${name}`);
      choice.append(new Option(`all ${name}s`, ""));
      for (const value of new Set(rows.map((row) => row.dataset[name]))) choice.append(new Option(value, value));
      choice.hidden = choice.length < 3; // nothing to choose
      choice.addEventListener("change", show);
      return { name, choice };
    });
    function show() {
      for (const row of rows) {
        row.hidden = choices.some(({ name, choice }) => choice.value && row.dataset[name] !== choice.value);
      }
      said.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} rows`;
    }
    place.append(...choices.map(({ choice }) => choice), said);
    place.hidden = choices.every(({ choice }) => choice.hidden);
    show();
  }
})();
