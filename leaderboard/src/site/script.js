"use strict";

// Sorting, filtering, ranking by another score, image sliders and what charts say on hover. The pages
// read well without it.

const collator = new Intl.Collator("en", { numeric: true });

// Of a long table the first rows are shown, which keeps sorting quick; a button shows all.
const SHOWN_ROWS = 100;

// A table that sorts and filters. Rows that are not shown are kept here and not in the page, so that
// the browser lays out no more than what is seen.
class SortableTable {
  constructor(table) {
    const tool = (attribute) => document.querySelector(`[data-${attribute}="${table.id}"]`);
    [this.filter, this.count, this.all] = ["filter", "count", "all"].map(tool);
    this.table = table;
    this.body = table.querySelector("tbody.measured");
    this.entries = Array.from(this.body.rows, (row, index) => ({ row, index, text: null }));
    this.keys = new Map();
    this.limit = SHOWN_ROWS;
    table.tHead.addEventListener("click", (event) => {
      const button = event.target.closest("button");
      if (button) this.sortBy(button.closest("th"));
    });
    this.filter.addEventListener("input", () => this.arrange());
    this.all.addEventListener("click", () => {
      this.limit = Infinity;
      this.arrange();
    });
    const columns = tool("columns");
    columns?.addEventListener("change", () => table.classList.toggle("few", !columns.checked));
    this.ranking = tool("rank");
    if (this.ranking) {
      this.ranks = this.entries.map(({ row }) => [row.cells[0].textContent, row.cells[0].dataset.value]);
      this.contests = [...new Set(this.entries.map(({ row }) => row.dataset.contest))];
      this.ranking.addEventListener("change", () => this.rank());
      this.markRanked();
    }
    this.arrange();
  }

  get headings() {
    return [...this.table.tHead.rows].at(-1).cells;
  }

  // The heading of the score that ranks are by.
  markRanked() {
    const ranked = Number(this.ranking.value);
    for (const each of this.headings) each.classList.toggle("ranked", each.cellIndex === ranked);
  }

  // Ranks by the chosen score within each class; equals share the better rank. The page comes with
  // ranks by the first choice, which have intervals.
  rank() {
    const column = Number(this.ranking.value);
    const isFirst = this.ranking.selectedIndex === 0;
    const sign = this.headings[column].dataset.first === "ascending" ? 1 : -1;
    const scores = this.keysOf(column);
    const contestOf = (entry) => entry.row.dataset.contest;
    const rivals = new Map(this.contests.map((contest) => [contest, []]));
    for (const entry of this.entries) {
      if (contestOf(entry) && scores[entry.index] !== null) rivals.get(contestOf(entry)).push(scores[entry.index]);
    }
    const better = (a, b) => sign * (a - b);
    for (const list of rivals.values()) list.sort(better);
    const places = [];
    for (const entry of this.entries) {
      const [score, list] = [scores[entry.index], contestOf(entry) && rivals.get(contestOf(entry))];
      const rank = list && score !== null ? 1 + list.indexOf(score) : null;
      places[entry.index] = rank ?? Infinity;
      const shown = isFirst ? this.ranks[entry.index] : rank ? [`${rank} of ${list.length}`, `${rank}`] : ["–", ""];
      [entry.row.cells[0].textContent, entry.row.cells[0].dataset.value] = shown;
      if (isFirst) places[entry.index] = shown[1] === "" ? Infinity : Number(shown[1]);
    }
    this.keys.delete(0);
    const order = (entry) => this.contests.indexOf(contestOf(entry));
    this.entries.sort((left, right) => {
      const [a, b] = [places[left.index], places[right.index]];
      return order(left) - order(right) || (a === b ? left.index - right.index : a - b);
    });
    for (const each of this.headings) each.setAttribute("aria-sort", "none");
    this.markRanked();
    this.arrange();
  }

  sortBy(heading) {
    const first = heading.dataset.first;
    const other = first === "ascending" ? "descending" : "ascending";
    const order = heading.getAttribute("aria-sort") === first ? other : first;
    for (const each of heading.parentElement.cells) each.setAttribute("aria-sort", "none");
    heading.setAttribute("aria-sort", order);
    const sign = order === "ascending" ? 1 : -1;
    const keys = this.keysOf(heading.cellIndex);
    // Missing values stay at the end, whichever way a column is sorted.
    this.entries.sort((left, right) => {
      const [a, b] = [keys[left.index], keys[right.index]];
      if (a === null || b === null) return (a === null) - (b === null);
      return sign * (a - b);
    });
    this.arrange();
  }

  // One number for every row by its place in the page as it was loaded; null where it has no value.
  keysOf(column) {
    let keys = this.keys.get(column);
    if (keys) return keys;
    const texts = [];
    for (const { row, index } of this.entries) {
      const cell = row.cells[column];
      texts[index] = cell.dataset.value ?? cell.textContent;
    }
    keys = texts.map((text) => (text === "" ? null : Number(text)));
    if (keys.some(Number.isNaN)) {
      const order = [...new Set(texts)].sort(collator.compare);
      const ranks = new Map(order.map((text, rank) => [text, rank]));
      keys = texts.map((text) => (text === "" ? null : ranks.get(text)));
    }
    this.keys.set(column, keys);
    return keys;
  }

  // A row stays when it contains every word of the filter, in whatever order.
  arrange() {
    const words = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    const matches = (entry) => {
      entry.text ??= entry.row.textContent.toLowerCase();
      return words.every((word) => entry.text.includes(word));
    };
    const found = words.length ? this.entries.filter(matches) : this.entries;
    const shown = found.slice(0, this.limit);
    this.body.replaceChildren(...shown.map((entry) => entry.row));
    const total = this.entries.length;
    const rows = total === 1 ? "row" : "rows";
    const all = `${total.toLocaleString("en")} ${rows}`;
    const count = words.length ? `${found.length.toLocaleString("en")} of ${all}` : all;
    const isCut = shown.length < found.length;
    this.count.value = isCut ? `${count}, ${this.limit} of them shown` : count;
    this.all.hidden = !isCut;
  }
}

for (const table of document.querySelectorAll("table.sortable")) new SortableTable(table);

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
  const figure = chart.closest("figure");
  figure.append(tip);
  const show = (event) => {
    const text = event.target.dataset?.tip;
    if (!text) return;
    const point = event.target.getBoundingClientRect();
    const frame = figure.getBoundingClientRect();
    tip.textContent = text;
    tip.hidden = false;
    const half = tip.offsetWidth / 2;
    const middle = point.left + point.width / 2 - frame.left;
    tip.style.left = `${Math.max(half, Math.min(frame.width - half, middle))}px`;
    tip.style.top = `${point.top + point.height / 2 - frame.top}px`;
  };
  const hide = () => { tip.hidden = true; };
  chart.addEventListener("pointerover", show);
  chart.addEventListener("focusin", show);
  chart.addEventListener("pointerout", hide);
  chart.addEventListener("focusout", hide);
}
