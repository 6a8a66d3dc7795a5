"use strict";
// Shows the boundaries of one video and keeps what is decided on them. See audit/mod.rs for the data.
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const decisions = [];
const rows = [];
let current = 0;

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

/** Notes a decision with its time, its reason and who it is about. */
const decide = (action) => {
  const reason = byId("reason").value.trim();
  decisions.push({ time: new Date().toISOString(), ...(reason && { reason }), action });
  byId("reason").value = "";
  say(`${decisions.length} decisions not saved`);
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

const accept = (row) => {
  row.state = "accepted";
  decide({ accept: row.id });
  draw(row);
};
const reject = (row) => {
  row.state = "rejected";
  decide({ reject: row.id });
  draw(row);
};
const move = (row, byBegin, byEnd) => {
  const begin = row.begin + byBegin, end = row.end + byEnd;
  if (begin < 0 || end >= data.times.length || end <= begin) return;
  [row.begin, row.end, row.state] = [begin, end, "moved"];
  // Steps of one move are one decision.
  const last = decisions.at(-1);
  if (last && last.action.move && last.action.move.id === row.id) decisions.pop();
  decide({ move: { id: row.id, boundary: shape(row) } });
  draw(row);
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
};

const addRow = (candidate, pictures) => {
  const row = {
    id: candidate.id,
    boundary: candidate.boundary,
    begin: nearestFrame(candidate.boundary.begin_seconds),
    end: nearestFrame(candidate.boundary.end_seconds),
    state: candidate.status,
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
  for (const picture of pictures) {
    const image = element("img", { src: picture.url, alt: `Frame ${picture.frame}`, loading: "lazy" });
    const caption = element("figcaption", { textContent: data.times[picture.frame].toFixed(3) });
    const figure = element("figure", {}, [image, caption]);
    row.figures.set(picture.frame, figure);
    strip.append(figure);
  }
  const who = candidate.authors.map((one) => author(one).split(":")[0]).join(", ");
  row.item = element("li", { tabIndex: 0 }, [
    element("div", { className: "head" }, [
      row.time, row.kind, row.stateText,
      element("span", { className: "who", textContent: `by ${who}, score ${candidate.boundary.score.toFixed(2)}` }),
      button("Accept", accept),
      button("Reject", reject),
      button("Earlier", (it) => move(it, -1, -1)),
      button("Later", (it) => move(it, 1, 1)),
    ]),
    strip,
  ]);
  row.item.addEventListener("focus", () => select(rows.indexOf(row), false));
  rows.push(row);
  byId("boundaries").append(row.item);
  draw(row);
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
  byId("boundaries").append(element("li", { tabIndex: 0 }, [
    element("div", { className: "head" }, [
      element("span", { className: "time", textContent: `${seconds(boundary.begin_seconds)} to ${seconds(boundary.end_seconds)}` }),
      element("span", { textContent: boundary.kind }),
      element("span", { className: "state", textContent: "added" }),
    ]),
  ]));
  byId("boundaries").lastElementChild.dataset.state = "added";
  byId("none").hidden = true;
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
byId("add").addEventListener("submit", (event) => { event.preventDefault(); add(); });
window.addEventListener("beforeunload", (event) => {
  if (byId("status").textContent.endsWith("not saved")) event.preventDefault();
});

byId("video").textContent = `${data.source.file_name}, ${data.times.length} frames, ${data.candidates.length} boundaries`;
document.title = `Boundary audit: ${data.source.file_name}`;
for (const kind of data.kinds) byId("add-kind").append(element("option", { textContent: kind }));
data.candidates.forEach((candidate, index) => addRow(candidate, data.filmstrips[index]));
byId("none").hidden = rows.length > 0;
for (const picture of data.overview) {
  const time = data.times[picture.frame];
  const shown = element("button", { type: "button", title: seconds(time) },
    [element("img", { src: picture.url, alt: `At ${seconds(time)}`, loading: "lazy" })]);
  shown.addEventListener("click", () => { byId("add-time").value = time; });
  byId("overview").append(shown);
}
select(0, false);
