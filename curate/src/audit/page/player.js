// The small video, by frames of the original: what is shown, scrubbing, marks, and the timeline.
const player = byId("player");
const marks = { begin: null, end: null };
// The frame that is shown or asked for.
let shown = 0;
// Speed while playing backwards, which browsers do not do by themselves.
let backwards = 0;

const lastFrame = data.times.length - 1;
/** Index of the last frame that has begun. */
const frameAt = (time) => {
  let low = 0, high = lastFrame;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (data.times[middle] <= time + 1e-4) low = middle; else high = middle - 1;
  }
  return low;
};

const showPosition = () => {
  const span = data.end_seconds - data.times[0];
  byId("position").textContent = `${seconds(data.times[shown])}, frame ${shown} of ${data.times.length}`;
  byId("timeline").setAttribute("aria-valuenow", String(shown));
  byId("timeline").setAttribute("aria-valuetext", seconds(data.times[shown]));
  playhead.style.left = `${100 * (data.times[shown] - data.times[0]) / span}%`;
};
const playhead = element("span", { className: "playhead" });

/** Shows a frame. */
const seek = (frame) => {
  shown = Math.min(Math.max(frame, 0), lastFrame);
  if (!player.seeking) goToShown();
  showPosition();
};
/** The time asked for is inside of the frame, because containers round. */
const goToShown = () => {
  player.currentTime = (data.times[shown] + endOf(shown)) / 2 - data.times[0];
};
// One seek at a time: with several on their way, Chromium on a busy machine may never end the last.
player.addEventListener("seeked", () => {
  if (player.paused && frameAt(player.currentTime + data.times[0]) !== shown) goToShown();
});
const pause = () => {
  backwards = 0;
  player.pause();
};
const play = (rate) => {
  backwards = 0;
  player.playbackRate = rate;
  player.play().catch((error) => say(`The video does not play (${error.name}).`));
};
const playOrPause = () => (player.paused && !backwards ? play(1) : pause());
const faster = () => play(player.paused ? 1 : Math.min(player.playbackRate * 2, 4));
const playBackwards = () => {
  const rate = Math.min(Math.max(backwards * 2, 1), 4);
  player.pause();
  let begun = null, from = data.times[shown];
  const step = (now) => {
    if (!backwards) return;
    if (rate !== backwards) return;
    begun ??= now;
    const time = from - rate * (now - begun) / 1000;
    seek(frameAt(time));
    if (time <= data.times[0]) return pause();
    requestAnimationFrame(step);
  };
  backwards = rate;
  requestAnimationFrame(step);
};
const stepFrames = (count) => { pause(); seek(shown + count); };
const stepSeconds = (count) => { pause(); seek(frameAt(data.times[shown] + count)); };

/** Follows the video while it plays. */
const follow = () => {
  if (!player.paused) {
    shown = frameAt(player.currentTime + data.times[0]);
    showPosition();
    requestAnimationFrame(follow);
  }
};
player.addEventListener("play", follow);
for (const [event, text] of [["play", "Pause"], ["pause", "Play"]]) {
  player.addEventListener(event, () => { byId("play").textContent = text; });
}
player.addEventListener("error", () => { byId("unplayable").hidden = false; });

const mark = (which) => {
  marks[which] = shown;
  if (marks.begin !== null && marks.end !== null && marks.end < marks.begin) {
    marks[which === "begin" ? "end" : "begin"] = null;
  }
  showMarks();
};
const clearMarks = () => {
  marks.begin = marks.end = null;
  showMarks();
};
const showMarks = () => {
  const of = (frame) => (frame === null ? "not marked" : seconds(data.times[frame]));
  byId("marked").textContent = marks.begin === null && marks.end === null
    ? "Nothing: a boundary is added before the frame that is shown."
    : `First frame ${of(marks.begin)}, last frame ${of(marks.end)}`;
  showTimeline();
};

/** Where an instant lies on the timeline, percent. */
const across = (time) => 100 * (time - data.times[0]) / (data.end_seconds - data.times[0]);
const spanOnTimeline = (className, begin, end, title) => {
  const made = element("span", { className, title });
  made.style.left = `${across(begin)}%`;
  made.style.width = `${Math.max(across(end) - across(begin), 0)}%`;
  return made;
};
const showTimeline = () => {
  const parts = allLabels().map(({ label }) =>
    spanOnTimeline("labelled", label.range.begin_seconds, label.range.end_seconds, labelText(label)));
  for (const row of rows.filter((one) => !one.hidden)) {
    const { begin_seconds, end_seconds, kind } = shape(row);
    const tick = spanOnTimeline("tick", begin_seconds, end_seconds, `${kind} at ${seconds(end_seconds)}`);
    tick.dataset.state = row.state;
    parts.push(tick);
  }
  if (marks.begin !== null || marks.end !== null) {
    const begin = marks.begin ?? marks.end, end = marks.end ?? marks.begin;
    parts.push(spanOnTimeline("marked", data.times[begin], endOf(end), "marked"));
  }
  byId("timeline").replaceChildren(...parts, playhead);
};

const seekToPointer = (event) => {
  const box = byId("timeline").getBoundingClientRect();
  const share = (event.clientX - box.left) / box.width;
  pause();
  seek(frameAt(data.times[0] + share * (data.end_seconds - data.times[0])));
};
byId("timeline").addEventListener("pointerdown", (event) => {
  byId("timeline").setPointerCapture(event.pointerId);
  seekToPointer(event);
});
byId("timeline").addEventListener("pointermove", (event) => { if (event.buttons) seekToPointer(event); });
byId("timeline").setAttribute("aria-valuemax", String(lastFrame));

/** The video in this file, or the one that lies beside it. */
const loadPlayer = () => {
  const embedded = byId("proxy").textContent.trim();
  if (!embedded) {
    player.src = data.proxy_file.split("/").map(encodeURIComponent).join("/");
    return;
  }
  const bytes = Uint8Array.from(atob(embedded), (letter) => letter.charCodeAt(0));
  player.src = URL.createObjectURL(new Blob([bytes], { type: "video/mp4" }));
};
