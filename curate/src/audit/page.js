"use strict";
// Shows the boundaries of one video and keeps what is decided on them. See audit/mod.rs for the data.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const decisions = [];
const rows = [];
let current = 0;
// Decisions outlive the page: browsers close, and an hour's work is lost.
const autosaved = `omnilife audit ${data.source.sha256}`;

const element = (tag, properties = {}, children = []) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};
const seconds = (value) => `${value.toFixed(3)} s`;
const say = (text) => { byId("status").textContent = text; };

/** Index of the frame whose timestamp is nearest. */
const nearestFrame = (time) => {
  let low = 0, high = data.times.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (data.times[middle] < time) low = middle + 1; else high = middle;
  }
  return low > 0 && time - data.times[low - 1] <= data.times[low] - time ? low - 1 : low;
};

/** Keeps the decisions in this browser; where it has no storage, the page says so. */
const keep = () => {
  try {
    if (decisions.length) localStorage.setItem(autosaved, JSON.stringify(decisions));
    else localStorage.removeItem(autosaved);
    say(`${decisions.length} decisions not saved to a file`);
  } catch (error) {
    say(`${decisions.length} decisions not saved, and this browser keeps none (${error.name})`);
  }
};

/** Notes a decision with its time and its reason, and shows what follows. */
const decide = (action) => {
  const reason = byId("reason").value.trim();
  decisions.push({ time: new Date().toISOString(), ...(reason && { reason }), action });
  byId("reason").value = "";
  show(decisions.at(-1));
  keep();
};

/** Shows what one decision makes of its boundary. */
const show = (decision) => {
  const action = decision.action;
  if (action.propose) return addedRow(decision);
  const id = action.accept ?? action.reject ?? action.move.id;
  const row = rows.find((one) => one.id === id);
  if (!row) return;
  if (action.move) {
    row.begin = nearestFrame(action.move.boundary.begin_seconds);
    row.end = nearestFrame(action.move.boundary.end_seconds);
  }
  row.state = action.move ? "moved" : "accept" in action ? "accepted" : "rejected";
  draw(row);
};

/** Shows all rows as the decisions that are left have it. */
const replay = () => {
  for (const row of rows.filter((one) => one.decision)) row.item.remove();
  rows.splice(0, rows.length, ...rows.filter((one) => !one.decision));
  for (const row of rows) {
    Object.assign(row, row.proposed);
    draw(row);
  }
  decisions.forEach(show);
  select(current, false);
  keep();
};

const undo = () => {
  if (!decisions.length) return say("There is nothing to undo.");
  decisions.pop();
  replay();
};

const shape = (row) => {
  const begin = row.begin, end = row.end;
  const asked = row.boundary.kind;
  const kind = asked !== "cut" && asked !== "gradual" ? asked : end - begin === 1 ? "cut" : "gradual";
  return { begin_seconds: data.times[begin], end_seconds: data.times[end], kind, score: row.boundary.score };
};

const draw = (row) => {
  const found = shape(row);
  row.item.dataset.state = row.state;
  row.time.textContent = `${seconds(found.begin_seconds)} to ${seconds(found.end_seconds)}`;
  row.kind.textContent = found.kind;
  row.stateText.textContent = row.state;
  for (const [frame, figure] of row.figures) {
    figure.classList.toggle("ends-old", frame === row.begin);
    figure.classList.toggle("begins-new", frame === row.end);
  }
};

const accept = (row) => row.decision || decide({ accept: row.id });
const reject = (row) => (row.decision ? withdraw(row) : decide({ reject: row.id }));
/** Takes back a boundary that was added here. */
const withdraw = (row) => {
  decisions.splice(decisions.indexOf(row.decision), 1);
  replay();
};
const move = (row, byBegin, byEnd) => {
  const begin = row.begin + byBegin, end = row.end + byEnd;
  if (begin < 0 || end >= data.times.length || end <= begin) return;
  [row.begin, row.end] = [begin, end];
  if (row.decision) {
    row.decision.action.propose = shape(row);
    draw(row);
    return keep();
  }
  // Steps of one move are one decision.
  const last = decisions.at(-1);
  if (last && last.action.move && last.action.move.id === row.id) decisions.pop();
  decide({ move: { id: row.id, boundary: shape(row) } });
};

const author = (who) => Object.values(who)[0];

const select = (index, focus = true) => {
  if (!rows.length) return;
  current = Math.min(Math.max(index, 0), rows.length - 1);
  rows.forEach((row, at) => row.item.setAttribute("aria-current", String(at === current)));
  if (focus) {
    rows[current].item.focus({ preventScroll: true });
    rows[current].item.scrollIntoView({ block: "nearest" });
  }
  centre(rows[current]);
};

/** Scrolls a strip of frames to its boundary. */
const centre = (row) => {
  const figure = row.figures.get(row.end) ?? row.figures.get(row.begin);
  if (!figure) return;
  const strip = figure.parentElement;
  strip.scrollLeft = figure.offsetLeft - strip.offsetLeft - strip.clientWidth / 2;
};

/** Rows stand in order of time. */
const place = (row) => {
  const at = rows.findIndex((other) => other.begin > row.begin);
  if (at < 0) rows.push(row);
  else rows.splice(at, 0, row);
  byId("boundaries").insertBefore(row.item, at < 0 ? null : rows[at + 1].item);
};

const addRow = (candidate, images, decision) => {
  const proposed = {
    begin: nearestFrame(candidate.boundary.begin_seconds),
    end: nearestFrame(candidate.boundary.end_seconds),
    state: candidate.status,
  };
  const row = {
    id: candidate.id,
    boundary: candidate.boundary,
    // Only a boundary that was added here has the decision that adds it.
    decision,
    proposed,
    ...proposed,
    time: element("span", { className: "time" }),
    kind: element("span"),
    stateText: element("span", { className: "state" }),
    figures: new Map(),
  };
  const button = (text, act) => {
    const made = element("button", { type: "button", textContent: text });
    made.addEventListener("click", () => { select(rows.indexOf(row), false); act(row); });
    return made;
  };
  const strip = element("div", { className: "strip" });
  for (const { url, frame } of images) {
    const image = element("img", { src: url, alt: `Frame ${frame}`, loading: "lazy" });
    const caption = element("figcaption", { textContent: data.times[frame].toFixed(3) });
    const figure = element("figure", {}, [image, caption]);
    row.figures.set(frame, figure);
    strip.append(figure);
  }
  const who = candidate.authors.map((one) => author(one).split(/[:@]/)[0]).join(", ");
  row.item = element("li", { tabIndex: 0 }, [
    element("div", { className: "head" }, [
      row.time, row.kind, row.stateText,
      element("span", { className: "who", textContent: `by ${who}, score ${candidate.boundary.score.toFixed(2)}` }),
      ...(decision ? [button("Remove", withdraw)] : [button("Accept", accept), button("Reject", reject)]),
      button("Earlier", (it) => move(it, -1, -1)),
      button("Later", (it) => move(it, 1, 1)),
    ]),
    strip,
  ]);
  row.item.addEventListener("focus", () => select(rows.indexOf(row), false));
  place(row);
  draw(row);
  byId("none").hidden = true;
};

const addedRow = (decision) => {
  const candidate = { boundary: decision.action.propose, authors: [{ expert: "you" }], status: "added" };
  addRow(candidate, [], decision);
};

const add = () => {
  const end = nearestFrame(Number(byId("add-time").value));
  const length = Number(byId("add-length").value);
  const begin = length > 0 ? nearestFrame(data.times[end] - length) : end - 1;
  if (begin < 0 || begin >= end) return say("There is no frame before it.");
  const boundary = {
    begin_seconds: data.times[begin], end_seconds: data.times[end],
    kind: byId("add-kind").value, score: 1,
  };
  decide({ propose: boundary });
};

const save = () => {
  const name = byId("author").value.trim();
  if (!name) {
    byId("author").focus();
    return say("Your name goes into the ledger: please fill it in.");
  }
  const file = { schema: data.schema, source_sha256: data.source.sha256, author: name, decisions };
  const url = URL.createObjectURL(new Blob([JSON.stringify(file, null, 2) + "\n"], { type: "application/json" }));
  element("a", { href: url, download: "decisions.json" }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
  say(`${decisions.length} decisions saved`);
};

const keys = {
  j: () => select(current + 1),
  k: () => select(current - 1),
  a: () => rows.length && accept(rows[current]),
  r: () => rows.length && reject(rows[current]),
  ArrowLeft: (event) => rows.length && move(rows[current], event.shiftKey ? 0 : -1, -1),
  ArrowRight: (event) => rows.length && move(rows[current], event.shiftKey ? 0 : 1, 1),
  s: save,
  u: undo,
};
document.addEventListener("keydown", (event) => {
  if (event.target.closest("input, select, summary") || event.ctrlKey || event.metaKey || event.altKey) return;
  const key = keys[event.key] ?? keys[event.key.toLowerCase()];
  if (key) {
    event.preventDefault();
    key(event);
  }
});
byId("save").addEventListener("click", save);
byId("undo").addEventListener("click", undo);
byId("next").addEventListener("click", () => select(current + 1));
byId("previous").addEventListener("click", () => select(current - 1));
byId("add").addEventListener("submit", (event) => { event.preventDefault(); add(); });
window.addEventListener("beforeunload", (event) => {
  if (byId("status").textContent.includes("not saved")) event.preventDefault();
});

byId("video").textContent = `${data.source.file_name}, ${data.times.length} frames, ${data.candidates.length} boundaries`;
document.title = `Boundary audit: ${data.source.file_name}`;
for (const kind of data.kinds) byId("add-kind").append(element("option", { textContent: kind }));
data.candidates.forEach((candidate, index) => addRow(candidate, data.filmstrips[index]));
byId("none").hidden = rows.length > 0;
for (const image of data.overview) {
  const time = data.times[image.frame];
  const shown = element("button", { type: "button", title: seconds(time) },
    [element("img", { src: image.url, alt: `At ${seconds(time)}`, loading: "lazy" })]);
  shown.addEventListener("click", () => { byId("add-time").value = time; });
  byId("overview").append(shown);
}
try {
  decisions.push(...JSON.parse(localStorage.getItem(autosaved) ?? "[]"));
} catch (error) {
  say(`What was decided here before cannot be read (${error.name}).`);
}
if (decisions.length) replay();
select(0, false);
// Pictures have no width before they are loaded.
addEventListener("load", () => rows.forEach(centre));
