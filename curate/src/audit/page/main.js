// Keys, buttons, and the first look.
const keys = {
  " ": playOrPause,
  j: playBackwards,
  k: pause,
  l: faster,
  ArrowLeft: (event) => (event.shiftKey ? stepSeconds(-1) : stepFrames(-1)),
  ArrowRight: (event) => (event.shiftKey ? stepSeconds(1) : stepFrames(1)),
  i: () => mark("begin"),
  o: () => mark("end"),
  g: labelSegment,
  n: () => select(current + 1),
  p: () => select(current - 1),
  a: () => selected() && accept(selected()),
  r: () => selected() && reject(selected()),
  ",": () => selected() && move(selected(), -1, -1),
  ".": () => selected() && move(selected(), 1, 1),
  "<": () => selected() && move(selected(), 0, -1),
  ">": () => selected() && move(selected(), 0, 1),
  u: (event) => (event.shiftKey ? redo() : undo()),
  s: save,
};
data.kinds.forEach((kind, index) => { keys[index + 1] = () => addBoundary(kind); });
document.addEventListener("keydown", (event) => {
  const target = event.target;
  if (target.closest("input:not([type=checkbox]), select, summary") || event.altKey) return;
  if (event.ctrlKey || event.metaKey) {
    if (event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    return event.shiftKey ? redo() : undo();
  }
  // A strip that has the focus scrolls.
  if (event.key.startsWith("Arrow") && target.closest(".strip:not(#overview)")) return;
  // A button that has the focus is pressed by the space bar.
  if (event.key === " " && target.closest("button, input")) return;
  const key = keys[event.key] ?? keys[event.key.toLowerCase()];
  if (key) {
    event.preventDefault();
    key(event);
  }
});
for (const [id, act] of Object.entries({
  save, undo, redo,
  "back-second": () => stepSeconds(-1), "back-frame": () => stepFrames(-1), play: playOrPause,
  "on-frame": () => stepFrames(1), "on-second": () => stepSeconds(1),
  "mark-begin": () => mark("begin"), "mark-end": () => mark("end"), "clear-marks": clearMarks,
  next: () => select(current + 1), previous: () => select(current - 1),
})) byId(id).addEventListener("click", act);
byId("add").addEventListener("submit", (event) => { event.preventDefault(); addBoundary(byId("add-kind").value); });
byId("label").addEventListener("submit", (event) => { event.preventDefault(); labelSegment(); });
byId("role").addEventListener("change", () => rows.forEach(drawRow));
addEventListener("beforeunload", (event) => { if (unsaved) event.preventDefault(); });

const counted = (count, name, many = `${name}s`) => `${count} ${count === 1 ? name : many}`;
byId("video").textContent = `${data.source.file_name}: ${counted(data.times.length, "frame")}, `
  + `${counted(data.candidates.length, "boundary", "boundaries")}, ${counted(data.suggestions.length, "suggestion")}`;
document.title = `Boundaries and labels: ${data.source.file_name}`;
byId("add-kind").append(...kindOptions());
for (const role of data.roles) byId("role").append(element("option", { textContent: role, value: role }));
nameChoice(byId("scene"), data.taxonomy.scenes);
nameChoice(byId("action"), data.taxonomy.actions);
data.candidates.forEach((candidate, index) => addRow(candidate, data.filmstrips[index]));
data.suggestions.forEach(({ boundary, author }, index) => addRow(
  { id: `suggestion ${index + 1}`, boundary, authors: [author], status: "suggested" }, [], { suggested: true }));
for (const image of data.overview) {
  const time = data.times[image.frame];
  const there = element("button", { type: "button", title: seconds(time) },
    [element("img", { src: image.url, alt: `At ${seconds(time)}`, loading: "lazy" })]);
  there.addEventListener("click", () => { pause(); seek(image.frame); });
  byId("overview").append(there);
}
listeners.push(showBoundaries, showLabels, showTimeline);
loadPlayer();
listeners.forEach((listener) => listener());
showMarks();
showPosition();
restore();
select(0, false);
// Images have no width before they are loaded.
addEventListener("load", () => rows.forEach(centre));
