"use strict";

// Sorting, filtering, image sliders and what charts say on hover. The pages read well without it.

const collator = new Intl.Collator("en", { numeric: true });

// Missing values stay at the end, whichever way a column is sorted.
function compare(left, right, sign) {
  if (left.missing || right.missing) return left.missing - right.missing;
  if (left.number !== null && right.number !== null) return sign * (left.number - right.number);
  return sign * collator.compare(left.text, right.text);
}

function keyOf(row, column) {
  const text = row.cells[column].dataset.value ?? row.cells[column].textContent;
  const number = text === "" ? NaN : Number(text);
  return { row, text, missing: text === "" ? 1 : 0, number: Number.isNaN(number) ? null : number };
}

function sortBy(table, heading) {
  const first = heading.dataset.first;
  const other = first === "ascending" ? "descending" : "ascending";
  const order = heading.getAttribute("aria-sort") === first ? other : first;
  for (const each of heading.parentElement.cells) each.setAttribute("aria-sort", "none");
  heading.setAttribute("aria-sort", order);
  const sign = order === "ascending" ? 1 : -1;
  const body = table.querySelector("tbody.measured");
  const keys = Array.from(body.rows, (row) => keyOf(row, heading.cellIndex));
  keys.sort((left, right) => compare(left, right, sign));
  body.append(...keys.map((key) => key.row));
  arrange(table);
}

// Of a long table the first rows are shown, which keeps sorting quick; a button shows all.
const SHOWN_ROWS = 200;

// A row stays when it contains every word of the filter, in whatever order.
function arrange(table) {
  const tools = toolsOf(table);
  const words = tools.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  const limit = table.dataset.all ? Infinity : SHOWN_ROWS;
  const rows = table.querySelector("tbody.measured").rows;
  let found = 0;
  for (const row of rows) {
    const matches = !words.length || words.every((word) => row.textContent.toLowerCase().includes(word));
    found += matches ? 1 : 0;
    row.hidden = !matches || found > limit;
  }
  const count = words.length ? `${found} of ${rows.length} rows` : `${rows.length} rows`;
  tools.count.value = found > limit ? `${count}, ${limit} of them shown` : count;
  tools.all.hidden = found <= limit;
}

function toolsOf(table) {
  const tool = (attribute) => document.querySelector(`[data-${attribute}="${table.id}"]`);
  return { filter: tool("filter"), count: tool("count"), all: tool("all") };
}

for (const table of document.querySelectorAll("table.sortable")) {
  table.tHead.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button) sortBy(table, button.closest("th"));
  });
  const tools = toolsOf(table);
  tools.filter.addEventListener("input", () => arrange(table));
  tools.all.addEventListener("click", () => {
    table.dataset.all = "yes";
    arrange(table);
  });
  arrange(table);
}

for (const figure of document.querySelectorAll("figure.compare")) {
  const slider = figure.querySelector("input.split");
  const error = figure.querySelector("input.error-map");
  const show = () => {
    figure.style.setProperty("--split", `${slider.value}%`);
    figure.classList.toggle("shows-error", error.checked);
    slider.disabled = error.checked;
  };
  slider.addEventListener("input", show);
  error.addEventListener("change", show);
  show();
}

for (const chart of document.querySelectorAll("svg.scatter")) {
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;
  tip.setAttribute("aria-hidden", "true");
  chart.parentElement.append(tip);
  const show = (event) => {
    const text = event.target.dataset?.tip;
    if (!text) return;
    const point = event.target.getBoundingClientRect();
    const frame = chart.parentElement.getBoundingClientRect();
    tip.textContent = text;
    tip.style.left = `${point.left + point.width / 2 - frame.left + chart.parentElement.scrollLeft}px`;
    tip.style.top = `${point.top + point.height / 2 - frame.top}px`;
    tip.hidden = false;
  };
  const hide = () => { tip.hidden = true; };
  chart.addEventListener("pointerover", show);
  chart.addEventListener("focusin", show);
  chart.addEventListener("pointerout", hide);
  chart.addEventListener("focusout", hide);
}
