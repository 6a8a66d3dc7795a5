// What is drawn: a scene on the graphics card, with its sorter.
let shown = null;

function open(scene) {
  const { count } = scene;
  const textures = gl ? texturesOf(scene) : {};
  if (shown) {
    for (const each of shown.workers) each.worker.terminate();
    for (const each of Object.values(shown.textures)) gl.deleteTexture(each);
  }
  // One that sorts, or one for each band of the picture.
  const most = count > 1e6 ? 2 : 4;
  const workers = Array.from({ length: gl ? 1 : Math.min(most, navigator.hardwareConcurrency || 1) }, () => ({
    worker: new Worker(URL.createObjectURL(new Blob([at("sorter").textContent], { type: "text/javascript" }))),
    buffer: new ArrayBuffer(8 * ROW * Math.ceil(count / ROW)), answer: null,
  }));
  shown = {
    scene, textures, workers, cuts: workers.map((_, number) => (number + 1) / workers.length),
    visible: 0, isSorting: false, isStale: true, time: 0, radius: radiusOf(scene), sortedAt: 0,
  };
  shown.near = shown.radius / 500;
  const { header, ...ofWorkers } = scene;
  const own = shown;
  for (const each of workers) {
    each.worker.onerror = (event) => fail(event.message);
    each.worker.onmessage = ({ data }) => {
      Object.assign(each, { buffer: data.buffer, answer: data });
      if (own === shown && workers.every(({ answer }) => answer)) sorted(workers.map(({ answer }) => answer));
    };
    each.worker.postMessage({ scene: { ...ofWorkers, near: shown.near }, draws: !gl });
  }
  Object.assign(state, { splats: count, length: header.time.seconds });
  const seconds = header.time.seconds;
  at("moments").hidden = !(seconds > 0);
  at("moment").max = seconds;
  at("moment").step = header.time.frames > 1 ? seconds / (header.time.frames - 1) : seconds / 250 || 1;
  say(`${count.toLocaleString("en")} Gaussians${seconds > 0 ? `, ${seconds.toFixed(1)} s` : ""}`);
  home(header.frame.up);
  seek(0);
  // Motion that one has not asked for can make ill.
  if (seconds > 0 && !matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);
}

// Half of the Gaussians are within this of the origin: steps and the nearest visible depth are shares of it.
function radiusOf({ position, count }) {
  const distances = [];
  for (let i = 0; i < count; i += Math.max(1, Math.floor(count / 2000))) distances.push(Math.hypot(...position.subarray(3 * i, 3 * i + 3)));
  return distances.sort((a, b) => a - b)[distances.length >> 1] || 1;
}

// Sorting.

// Time over which an order of a graphics card's Gaussians is used, seconds.
const AHEAD = 0.25;
// Milliseconds between orders: drawing needs the processors too.
const sortEvery = () => Math.min(200, Math.max(60, 3 * state.sortMilliseconds));
function sort(now) {
  if (!shown || shown.isSorting || !shown.isStale || (gl && player.isPlaying && now - shown.sortedAt < sortEvery())) return;
  const { right, down, ahead } = axes();
  const tangent = Math.tan(0.5 * look.field);
  const wide = tangent * canvas.clientWidth / canvas.clientHeight;
  const view = { time: shown.time, eye: look.eye, right, down, ahead };
  Object.assign(shown, { isSorting: true, isStale: false, sortedAt: now });
  const [width, height] = canvas.wanted;
  let begin = 0;
  shown.workers.forEach((each, number) => {
    const end = Math.max(begin, Math.round(height * shown.cuts[number]));
    // An order serves until the next one: the camera turns meanwhile, and Gaussians appear.
    const own = gl ? { tangents: [1.2 * wide, -1.2 * tangent, 1.2 * tangent], later: AHEAD }
      : { tangents: [wide, ...[begin, end].map((line) => tangent * (2 * line / height - 1))], later: 0, lines: [begin, end], width, height, focal: 0.5 * height / tangent };
    begin = end;
    each.answer = null;
    each.worker.postMessage({ view: { ...view, ...own }, buffer: each.buffer }, [each.buffer]);
  });
}
function sorted(answers) {
  const [{ visible, buffer }] = answers;
  const all = answers.reduce((sum, each) => sum + each.visible, 0);
  Object.assign(shown, { visible, isSorting: false });
  Object.assign(state, { visible: all, sortMilliseconds: Math.max(...answers.map(({ milliseconds }) => milliseconds)), ready: true });
  if (gl) {
    upload(shown, visible, buffer);
    return draw();
  }
  const { width, height } = answers[0].view;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  for (const { view: { lines: [begin, end] }, pixels } of answers) {
    if (end > begin) flat.putImageData(new ImageData(new Uint8ClampedArray(pixels), width, end - begin), 0, begin);
  }
  state.frames += 1;
  balance(answers, height);
  if (player.isPlaying && performance.now() - shown.sortedAt > 16) frame(performance.now());
  else if (shown.isStale || isMoving()) draw();
}
// Moves the cuts between bands to where their times would have been equal.
function balance(answers, height) {
  const total = answers.reduce((sum, { milliseconds }) => sum + milliseconds, 0);
  let [band, passed] = [0, 0];
  for (let number = 0; number + 1 < answers.length; number++) {
    const wanted = total * (number + 1) / answers.length;
    while (passed + answers[band].milliseconds < wanted) passed += answers[band++].milliseconds;
    const { milliseconds, view: { lines: [begin, end] } } = answers[band];
    const cut = (begin + (end - begin) * (wanted - passed) / milliseconds) / height;
    shown.cuts[number] += 0.3 * (cut - shown.cuts[number]);
  }
}
function upload(of, visible, buffer) {
  const lines = Math.ceil(visible / ROW);
  gl.activeTexture(gl.TEXTURE0 + UNITS.order);
  gl.bindTexture(gl.TEXTURE_2D, of.textures.order);
  if (lines > 0) gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ROW, lines, gl.RG_INTEGER, gl.UNSIGNED_INT, new Uint32Array(buffer, 0, 2 * ROW * lines));
}

// The camera: a place, a heading and a pitch over the ground.

const look = { eye: [0, 0, 0], heading: 0, pitch: 0, field: 75 * Math.PI / 180, up: [0, -1, 0], zero: [0, 0, 1] };
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const sum = (...terms) => [0, 1, 2].map((axis) => terms.reduce((all, [factor, vector]) => all + factor * vector[axis], 0));
const unit = (vector) => sum([1 / (Math.hypot(...vector) || 1), vector]);
function home(up) {
  const { eye, heading, pitch } = { eye: [0, 0, 0], heading: 0, pitch: 0 };
  const upwards = unit(up);
  const start = Math.abs(upwards[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const along = start.reduce((all, part, axis) => all + part * upwards[axis], 0);
  Object.assign(look, { eye, heading, pitch, up: upwards, zero: unit(sum([1, start], [-along, upwards])) });
}
function axes() {
  const side = cross(look.zero, look.up);
  const level = sum([Math.cos(look.heading), look.zero], [Math.sin(look.heading), side]);
  const ahead = sum([Math.cos(look.pitch), level], [Math.sin(look.pitch), look.up]);
  const right = unit(cross(ahead, look.up));
  return { level, ahead, right, down: cross(ahead, right) };
}
function stale() { if (shown) shown.isStale = true; draw(); }
function move(forward, sideways, upwards) {
  const step = 0.05 * (shown ? shown.radius : 1);
  const { ahead, right } = axes();
  look.eye = sum([1, look.eye], [step * forward, ahead], [step * sideways, right], [step * upwards, look.up]);
  stale();
}

// Drawing: on demand, and in every frame while time runs. Pixels are fewer while frames take long.

const NAMES = ["scene", "objects", "order", "gaussians", "camera", "eye", "focal", "viewport", "time", "near", "visible"];
function stage(vertex, fragment) {
  const program = programOf(vertex, fragment);
  const uniforms = NAMES.map((name) => [name, gl.getUniformLocation(program, name)]);
  return { program, uniforms: Object.fromEntries(uniforms) };
}
const UNITS = { scene: 0, objects: 1, order: 2, gaussians: 3 };
const projection = gl && stage(ANYWHERE, PROJECTED);
const drawing = gl && stage(VERTEX, FRAGMENT);
const target = gl && gl.createFramebuffer();
if (gl) {
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.clearColor(0, 0, 0, 1);
}

const SLOW = 31;
const FAST = 22;
const LEAST_SHARE = 0.25;
const pace = { share: gl ? 1 : 0.5, mean: 25, last: null, changed: 0 };
// Takes the time of a frame that follows another; `last` is null after a rest.
function measure(now) {
  if (pace.last !== null) {
    pace.mean += 0.15 * (Math.min(500, now - pace.last) - pace.mean);
    state.rate = 1000 / pace.mean;
    if (now - pace.changed > 250) {
      const wanted = pace.mean > SLOW ? 0.85 * pace.share : pace.mean < FAST ? 1.08 * pace.share : pace.share;
      pace.share = Math.min(1, Math.max(LEAST_SHARE, wanted));
      pace.changed = now;
    }
  }
  pace.last = now;
}

let isDue = false;
function draw() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(frame);
}
const isMoving = () => player.isPlaying || held.size > 0;
function frame(now) {
  isDue = false;
  if (!shown || (!gl && shown.isSorting)) return;
  if (isMoving()) measure(now); else pace.last = null;
  state.share = (isMoving() ? pace.share : 1) * devicePixelRatio;
  canvas.wanted = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * state.share)));
  advance(now);
  sort(now);
  if (!gl) return;
  const [width, height] = canvas.wanted;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  paint();
  state.frames += 1;
  if (isMoving() || (shown.isStale && !shown.isSorting)) draw();
}
function use({ program, uniforms }, textures) {
  gl.useProgram(program);
  for (const [name, texture] of Object.entries(textures)) {
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(uniforms[name], UNITS[name]);
  }
  gl.uniform2f(uniforms.viewport, canvas.width, canvas.height);
}
function paint() {
  if (shown.visible > 0) project();
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.enable(gl.BLEND);
  use(drawing, { order: shown.textures.order, gaussians: shown.textures.gaussians });
  gl.drawArrays(gl.TRIANGLES, 0, 3 * shown.visible);
}
function project() {
  const { uniforms } = projection;
  const { objects } = shown.scene;
  const { scene, order, objects: poses, gaussians } = shown.textures;
  use(projection, { scene, order, objects: poses });
  if (objects.length > 0) {
    const values = objects.flatMap((object) => {
      const pose = poseOf(object, shown.time);
      return pose ? [pose[0], pose[1], pose[2], 1, pose[3], pose[4], pose[5], pose[6]] : [0, 0, 0, 0, 0, 0, 0, 1];
    });
    gl.activeTexture(gl.TEXTURE0 + UNITS.objects);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 2 * objects.length, 1, gl.RGBA, gl.FLOAT, new Float32Array(values));
  }
  const { right, down, ahead } = axes();
  gl.uniformMatrix3fv(uniforms.camera, true, [...right, ...down, ...ahead]);
  gl.uniform3fv(uniforms.eye, look.eye);
  const focal = 0.5 * canvas.height / Math.tan(0.5 * look.field);
  gl.uniform2f(uniforms.focal, focal, focal);
  gl.uniform1f(uniforms.time, shown.time);
  gl.uniform1f(uniforms.near, shown.near);
  gl.uniform1i(uniforms.visible, shown.visible);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  // The texture of the last drawing must not be read while it is written.
  gl.activeTexture(gl.TEXTURE0 + UNITS.gaussians);
  gl.bindTexture(gl.TEXTURE_2D, null);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, gaussians, 0);
  gl.viewport(0, 0, ROW, Math.ceil(shown.visible / ROW));
  gl.disable(gl.BLEND);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}
// The sorter's own function, so that both place objects alike.
const poseOf = new Function(`${at("sorter").textContent}; return poseOf;`)();

// Time.

const player = { isPlaying: false, last: 0, written: 0 };
function advance(now) {
  if (!player.isPlaying) return;
  const passed = Math.min(0.1, (now - player.last) / 1000);
  player.last = now;
  const seconds = shown.scene.header.time.seconds;
  setTime(shown.time + passed > seconds ? 0 : shown.time + passed);
}
function setTime(time) {
  const seconds = shown.scene.header.time.seconds;
  shown.time = Math.max(0, Math.min(seconds, time));
  shown.isStale = true;
  state.seconds = shown.time;
  // Ten times a second are enough for reading.
  const now = performance.now();
  if (player.isPlaying && now - player.written < 100) return;
  player.written = now;
  at("moment").value = shown.time;
  const text = `${shown.time.toFixed(2)} of ${seconds.toFixed(2)} s`;
  at("seconds").textContent = text;
  at("moment").setAttribute("aria-valuetext", text);
}
function seek(time) { if (shown) { setTime(time); draw(); } }
function play(isPlaying) {
  if (!shown || !(shown.scene.header.time.seconds > 0)) return;
  Object.assign(player, { isPlaying, last: performance.now() });
  at("play").textContent = isPlaying ? "Pause" : "Play";
  stale();
}
Object.assign(state, { seek: (time) => { play(false); seek(time); }, play, repaint: () => { if (gl) paint(); } });
// For tests: a heading and pitch in radians, and a vertical field of view in degrees.
state.turn = (heading, pitch, field) => {
  Object.assign(look, { heading, pitch });
  if (field) look.field = field * Math.PI / 180;
  stale();
};

at("play").addEventListener("click", () => play(!player.isPlaying));
at("moment").addEventListener("input", (event) => { play(false); seek(Number(event.target.value)); });

// Pointers: one turns, two move.

const held = new Map();
const spread = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
canvas.addEventListener("pointerdown", (event) => { held.set(event.pointerId, [event.clientX, event.clientY]); canvas.setPointerCapture(event.pointerId); draw(); });
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => { held.delete(event.pointerId); stale(); });
canvas.addEventListener("pointermove", (event) => {
  const before = held.get(event.pointerId);
  if (!before) return;
  const apart = held.size === 2 ? spread() : 0;
  held.set(event.pointerId, [event.clientX, event.clientY]);
  if (held.size === 2) return move(0.05 * (spread() - apart), 0, 0);
  look.heading -= 0.004 * (event.clientX - before[0]);
  look.pitch = Math.max(-1.55, Math.min(1.55, look.pitch + 0.004 * (event.clientY - before[1])));
  stale();
});
canvas.addEventListener("wheel", (event) => { event.preventDefault(); move(-Math.sign(event.deltaY), 0, 0); }, { passive: false });
const STEPS = { w: [1, 0, 0], s: [-1, 0, 0], a: [0, -1, 0], d: [0, 1, 0], q: [0, 0, -1], e: [0, 0, 1] };
window.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || !shown) return;
  const step = STEPS[event.key.toLowerCase()];
  if (step) return move(...step);
  // A button and a summary have the space key themselves, a slider Home and End.
  const tag = event.target.tagName;
  if (event.key === " " && !["BUTTON", "SUMMARY"].includes(tag)) { event.preventDefault(); play(!player.isPlaying); }
  const one = Number(at("moment").step);
  const to = { ",": shown.time - one, ".": shown.time + one, ...(tag === "INPUT" ? {} : { Home: 0, End: Infinity }) }[event.key];
  if (to !== undefined) { play(false); seek(to); }
});
window.addEventListener("resize", stale);
if (document.fullscreenEnabled) {
  const whole = at("whole");
  whole.hidden = false;
  whole.addEventListener("click", () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen().catch(fail);
  });
  document.addEventListener("fullscreenchange", () => {
    whole.textContent = document.fullscreenElement ? "Leave full screen" : "Full screen";
  });
}
document.addEventListener("visibilitychange", () => { player.last = performance.now(); });

// Files: the one inside the page, or a chosen one.

async function load(bytes) {
  try {
    say("Loading");
    play(false);
    open(await sceneOf(bytes));
    state.error = null;
  } catch (error) { fail(error); }
}
async function loadFile(file) { if (file) load(new Uint8Array(await file.arrayBuffer())); }
at("file").addEventListener("change", (event) => loadFile(event.target.files[0]));
window.addEventListener("dragover", (event) => event.preventDefault());
window.addEventListener("drop", (event) => { event.preventDefault(); loadFile(event.dataTransfer.files[0]); });
const inside = at("inside").textContent.trim();
if (inside) load(Uint8Array.from(atob(inside), (letter) => letter.charCodeAt(0)));
else say("Open a .gtime file");
