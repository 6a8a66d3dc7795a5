// What segments show: those that the ledger says, and those that were labelled here.

/** Labels of the ledger and of this page, in order of time. */
const allLabels = () => {
  const here = decisions.filter((one) => one.action.label)
    .map((one) => ({ label: one.action.label, author: null, decision: one }));
  const there = data.labels.map(({ label, author }) => ({ label, author: nameOf(author) }));
  return [...there, ...here].sort((a, b) => a.label.range.begin_seconds - b.label.range.begin_seconds);
};
const labelText = (label) => [label.scene, label.action, label.traversal && "seamless traversal",
  label.leave_out && "left out", label.leave_out === false && "kept after all"].filter(Boolean).join(", ");

/** A segment that the ledger leaves out is taken back by a label of its own: the ledger forgets nothing. */
const keepAfterAll = (label) => {
  const keep = element("button", { type: "button", textContent: "Keep after all" });
  keep.addEventListener("click", () => decide({ label: { range: label.range, leave_out: false } }));
  return keep;
};
/** Whether some label keeps the segment of one. */
const isKept = ({ range }, labels) => labels.some(({ label }) => label.leave_out === false
  && label.range.begin_seconds <= range.begin_seconds && label.range.end_seconds >= range.end_seconds);

const showLabels = () => {
  const labels = allLabels();
  const items = labels.map(({ label, author, decision: own }) => {
    const { begin_seconds, end_seconds } = label.range;
    const show = element("button", { type: "button", textContent: "Show" });
    show.addEventListener("click", () => { pause(); seek(nearestFrame(begin_seconds)); });
    const remove = element("button", { type: "button", textContent: "Remove" });
    remove.addEventListener("click", () => withdraw(own));
    return element("li", {}, [element("div", { className: "head" }, [
      element("span", { className: "time", textContent: `${seconds(begin_seconds)} to ${seconds(end_seconds)}` }),
      element("span", { className: "state", textContent: labelText(label) }),
      element("span", { className: "who", textContent: author === null ? "not saved yet" : `by ${author}` }),
      show, ...(own ? [remove] : []),
      ...(!own && label.leave_out && !isKept(label, labels) ? [keepAfterAll(label)] : []),
    ])]);
  });
  byId("labels").replaceChildren(...items);
  byId("no-labels").hidden = items.length > 0;
};

/** Whether a boundary that holds already lies between two neighbouring frames, or over them. */
const isCutBefore = (frame) => rows.some((row) => !row.hidden && !row.suggested
  && row.state !== "rejected" && row.kind !== "seamless-traversal" && row.begin < frame && row.end >= frame);

const cutBefore = (frame) => ({ propose: {
  begin_seconds: data.times[frame - 1], end_seconds: data.times[frame], kind: "cut", score: 1,
} });

const labelSegment = () => {
  if (marks.begin === null || marks.end === null) {
    return say("Mark the first and the last frame of the segment first (I, O).");
  }
  const label = { range: { begin_seconds: data.times[marks.begin], end_seconds: endOf(marks.end) } };
  for (const name of ["scene", "action"]) if (byId(name).value) label[name] = byId(name).value;
  if (byId("traversal").checked) label.traversal = true;
  if (byId("leave-out").checked) label.leave_out = true;
  if (!labelText(label)) return say("Choose a scene or an action, or leave the segment out.");
  const ends = byId("cut-ends").checked ? [marks.begin, marks.end + 1] : [];
  const cuts = ends.filter((frame) => frame > 0 && frame <= lastFrame && !isCutBefore(frame)).map(cutBefore);
  decide(...cuts, { label });
  // What is left out is said of each segment anew.
  byId("leave-out").checked = false;
  clearMarks();
};

const nameChoice = (box, groups) => {
  box.append(element("option", { value: "", textContent: "not stated" }));
  for (const group of groups) {
    const options = group.members.map((name) => element("option", { value: name, textContent: name }));
    box.append(element("optgroup", { label: group.name }, options));
  }
};
