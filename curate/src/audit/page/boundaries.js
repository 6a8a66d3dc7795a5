// The rows of boundaries: those of the ledger, those that were added here, and suggestions.
const rows = [];
let current = 0;

/** The boundary as the row has it. Between neighbouring frames a gradual one is a cut, and the other way round. */
const shape = (row) => {
  const { begin, end } = row;
  const plain = row.kind === "cut" || row.kind === "gradual";
  const kind = plain ? (end - begin === 1 ? "cut" : "gradual") : row.kind;
  return { begin_seconds: data.times[begin], end_seconds: data.times[end], kind, score: row.score };
};

const drawRow = (row) => {
  const found = shape(row);
  row.item.dataset.state = row.state;
  row.item.hidden = row.hidden;
  row.time.textContent = `${seconds(found.begin_seconds)} to ${seconds(found.end_seconds)}`;
  row.kindBox.value = found.kind;
  row.stateText.textContent = row.state;
  // What others proposed is the experts' to decide on.
  const locked = !isExpert() && !row.added && !row.suggested;
  for (const control of row.item.querySelectorAll("button, select")) control.disabled = locked;
  for (const [frame, figure] of row.figures) {
    figure.classList.toggle("ends-old", frame === row.begin);
    figure.classList.toggle("begins-new", frame === row.end);
  }
};

/** Shows what one decision makes of its boundary. */
const showDecision = (one) => {
  const action = one.action;
  if (action.propose) {
    addRow({ boundary: action.propose, authors: [{ expert: "you" }], status: "added" }, [], { added: one });
    for (const row of rows) {
      if (row.suggested && Math.abs(data.times[row.end] - action.propose.end_seconds) < 0.5) row.hidden = true;
    }
  } else if (action.dismiss) {
    const row = rows.find((other) => other.suggested && other.id === action.dismiss);
    if (row) row.hidden = true;
  } else if (!action.label) {
    const row = rows.find((other) => other.id === (action.accept ?? action.reject ?? action.move.id));
    if (!row) return;
    if (action.move) {
      row.begin = nearestFrame(action.move.boundary.begin_seconds);
      row.end = nearestFrame(action.move.boundary.end_seconds);
      row.kind = action.move.boundary.kind;
    }
    row.state = action.move ? "moved" : "accept" in action ? "accepted" : "rejected";
  }
};

/** Shows all rows as the decisions have it. */
const showBoundaries = () => {
  for (const row of rows.filter((one) => one.added)) row.item.remove();
  rows.splice(0, rows.length, ...rows.filter((one) => !one.added));
  for (const row of rows) Object.assign(row, row.proposed, { hidden: false });
  decisions.forEach(showDecision);
  rows.forEach(drawRow);
  byId("none").hidden = rows.some((row) => !row.hidden);
  select(current, false);
};

const locked = (row) => {
  if (isExpert() || row.added || row.suggested) return false;
  say("What others proposed is decided on by experts.");
  return true;
};
const accept = (row) => {
  if (row.added || locked(row)) return;
  if (row.suggested) decide({ propose: { ...shape(row), score: 1 } });
  else decide({ accept: row.id });
};
const reject = (row) => {
  if (locked(row)) return;
  if (row.added) withdraw(row.added);
  else decide(row.suggested ? { dismiss: row.id } : { reject: row.id });
};
/** Gives a boundary other frames or another kind. */
const reshape = (row, next) => {
  if (locked(row) || next.begin < 0 || next.end > lastFrame || next.end <= next.begin) return;
  Object.assign(row, next);
  if (row.suggested) return accept(row);
  if (row.added) {
    const moved = { ...row.added, action: { propose: shape(row) } };
    return change(decisions.map((one) => (one === row.added ? moved : one)), `move ${row.added.time}`);
  }
  // Steps of one move are one decision.
  const last = decisions.at(-1);
  const kept = last?.action.move?.id === row.id ? decisions.slice(0, -1) : decisions;
  change([...kept, decision({ move: { id: row.id, boundary: shape(row) } })], `move ${row.id}`);
};
const move = (row, byBegin, byEnd) =>
  reshape(row, { begin: row.begin + byBegin, end: row.end + byEnd, kind: row.kind });

const select = (index, focus = true) => {
  const visible = rows.filter((row) => !row.hidden);
  if (!visible.length) return;
  current = Math.min(Math.max(index, 0), visible.length - 1);
  visible.forEach((row, at) => row.item.setAttribute("aria-current", String(at === current)));
  if (focus) {
    visible[current].item.focus({ preventScroll: true });
    visible[current].item.scrollIntoView({ block: "nearest" });
    pause();
    seek(visible[current].end);
  }
  centre(visible[current]);
};
const selected = () => rows.filter((row) => !row.hidden)[current];
const selectRow = (row) => select(rows.filter((one) => !one.hidden).indexOf(row), false);

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

const strip = (images, figures) => element("div", { className: "strip", tabIndex: 0, role: "group", ariaLabel: "Frames around the boundary" }, images.map(({ url, frame }) => {
  const image = element("img", { src: url, alt: `Frame ${frame}`, loading: "lazy" });
  const caption = element("figcaption", { textContent: data.times[frame].toFixed(3) });
  const figure = element("figure", {}, [image, caption]);
  figures.set(frame, figure);
  return figure;
}));

const kindOptions = () => data.kinds.map((kind) => element("option", { textContent: kind, value: kind }));
const nameOf = (author) => Object.values(author)[0].split(/[:@]/)[0];

/** Adds a row; `added` is the decision that adds it, `suggested` says that no ledger holds it. */
const addRow = (candidate, images, { added, suggested } = {}) => {
  const { boundary } = candidate;
  const proposed = {
    begin: nearestFrame(boundary.begin_seconds), end: nearestFrame(boundary.end_seconds),
    state: candidate.status, kind: boundary.kind,
  };
  const row = {
    id: candidate.id, score: boundary.score, added, suggested, hidden: false, proposed, ...proposed,
    time: element("span", { className: "time" }),
    kindBox: element("select", { ariaLabel: "Kind" }, kindOptions()),
    stateText: element("span", { className: "state" }),
    figures: new Map(),
  };
  const button = (text, act) => {
    const made = element("button", { type: "button", textContent: text });
    made.addEventListener("click", () => { selectRow(row); act(row); });
    return made;
  };
  row.kindBox.addEventListener("change", () =>
    reshape(row, { begin: row.begin, end: row.end, kind: row.kindBox.value }));
  const who = candidate.authors.map(nameOf).join(", ");
  row.item = element("li", { tabIndex: 0 }, [
    element("div", { className: "head" }, [
      row.time, row.kindBox, row.stateText,
      element("span", { className: "who", textContent: `by ${who}, score ${boundary.score.toFixed(2)}` }),
      button("Show", (it) => { pause(); seek(it.end); }),
      ...(added ? [button("Remove", reject)] : [button("Accept", accept), button("Reject", reject)]),
      button("Earlier", (it) => move(it, -1, -1)),
      button("Later", (it) => move(it, 1, 1)),
    ]),
    strip(images, row.figures),
  ]);
  row.item.addEventListener("focus", () => selectRow(row));
  place(row);
};

/** Adds a boundary over what is marked; with one mark before that frame, without any before the one shown. */
const addBoundary = (kind) => {
  let { begin, end } = marks;
  if (begin === null || end === null || begin === end) {
    end = begin ?? end ?? shown;
    begin = end - 1;
  }
  if (begin < 0) return say("There is no frame before it.");
  const adjacent = end - begin === 1;
  const plain = kind === "cut" || kind === "gradual";
  decide({ propose: {
    begin_seconds: data.times[begin], end_seconds: data.times[end],
    kind: plain ? (adjacent ? "cut" : "gradual") : kind, score: 1,
  } });
  clearMarks();
};
