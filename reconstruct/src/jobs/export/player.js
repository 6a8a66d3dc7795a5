// Plays Gaussians in time (docs/reference/gaussians-in-time.md): a reader, and a renderer in WebGL 2.
const at = (id) => document.getElementById(id);
const state = { splats: 0, visible: 0, frames: 0, ready: false, error: null, seconds: 0, rate: 0, sortMilliseconds: 0 };
window.omnilife = state;
const say = (text) => { at("status").textContent = text; };
const fail = (error) => { state.error = String(error.message || error); say(state.error); };

// Reading.

const WIDTHS = { position: 3, size: 3, rotation: 4, opacity: 1, colour: 3, velocity: 3, peak: 1, duration: 1, object: 1 };
const BYTES = { u8: 1, u16: 2, u24: 3, f32: 4 };
const refuse = (reason) => { throw new Error(`The file ${reason}`); };

function headerOf(bytes) {
  const magic = new TextDecoder().decode(bytes.subarray(0, 8));
  if (magic !== "GAUSTIME" || bytes.length < 12) refuse("is cut off, or no .gtime");
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(8, true);
  if (12 + length > bytes.length) refuse("is cut off in its header");
  const header = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes.subarray(12, 12 + length)));
  if (header.format !== "gaussians-in-time" || header.version !== 1) refuse(`is ${header.format} of version ${header.version}`);
  if (!(header.degree >= 0 && header.degree <= 3)) refuse(`has harmonics of degree ${header.degree}`);
  if (!(header.time.seconds >= 0)) refuse("has no length of time");
  for (const part of header.parts) {
    const names = part.arrays.map((array) => array.name);
    if (!["static", "linear", "periodic", "rigid"].includes(part.motion.kind)) refuse(`has the motion ${part.motion.kind}`);
    if (part.motion.kind === "periodic" && !(part.motion.cycle > 0)) refuse("has a cycle that is not positive");
    for (const name of ["position", "size", "rotation", "opacity", "colour", ...(part.motion.kind === "rigid" ? ["object"] : [])]) {
      if (!names.includes(name)) refuse(`has a part without ${name}`);
    }
    if (!(part.count >= 0) || new Set(names).size !== names.length) refuse("has a part without a count, or a name twice");
    for (const array of part.arrays) {
      const expected = array.name === "harmonics" ? 3 * ((header.degree + 1) ** 2 - 1) : WIDTHS[array.name] || array.width;
      if (!(array.width > 0) || array.width !== expected) refuse(`has ${array.name} of width ${array.width}`);
      const isKnown = array.type in BYTES && [undefined, "linear", "exp"].includes(array.map);
      const isBounded = array.type === "f32" || [array.low, array.high].every((bounds) => bounds && bounds.length === array.width && bounds.every(Number.isFinite));
      if (!isKnown || !isBounded) refuse(`has ${array.name} of an unknown type, or without bounds`);
    }
    for (const { times, positions, rotations } of part.motion.objects || []) {
      const isSound = times.length > 1 && positions.length === 3 * times.length - 2 && rotations.length === times.length;
      if (!isSound || times.some((time, index) => index > 0 && !(time > times[index - 1]))) refuse("has an object without a track");
    }
  }
  return { header, packed: bytes.subarray(12 + length) };
}

async function inflated(packed, length) {
  const bytes = new Uint8Array(length);
  const reader = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip")).getReader();
  let filled = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    if (filled + value.length > length) refuse("goes on behind its arrays");
    bytes.set(value, filled);
    filled += value.length;
  }
  if (filled < length) refuse("is cut off in its arrays");
  return bytes;
}

function decoded(array, count, bytes) {
  const { width, type, low, high } = array;
  const values = new Float32Array(count * width);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const most = 256 ** BYTES[type] - 1;
  for (let at = 0, column = 0; at < values.length; at++) {
    let value;
    if (type === "f32") value = view.getFloat32(4 * at, true);
    else {
      const q = type === "u8" ? bytes[at] : type === "u16" ? view.getUint16(2 * at, true) : bytes[3 * at] | bytes[3 * at + 1] << 8 | bytes[3 * at + 2] << 16;
      value = low[column] + (high[column] - low[column]) * q / most;
    }
    values[at] = array.map === "exp" ? Math.exp(value) : value;
    if (++column === width) column = 0;
  }
  return values;
}

// Arrays over all Gaussians, as the renderer and the sorter use them.
async function sceneOf(file) {
  const { header, packed } = headerOf(file);
  const { parts, degree } = header;
  const rowBytes = (array) => array.width * BYTES[array.type];
  const total = parts.reduce((sum, part) => sum + part.arrays.reduce((row, array) => row + rowBytes(array), 0) * part.count, 0);
  const count = parts.reduce((sum, part) => sum + part.count, 0);
  if (count === 0) refuse("holds no Gaussians");
  if (total > 1000 * packed.length + 1e6) refuse("is cut off in its arrays");
  const bytes = await inflated(packed, total);
  const floats = (width, value = 0) => new Float32Array(width * count).fill(value);
  const rest = 3 * ((degree + 1) ** 2 - 1);
  const withHarmonics = parts.filter((part) => part.arrays.some((array) => array.name === "harmonics"));
  const scene = {
    header, count, degree, rest, objects: [],
    position: floats(3), size: floats(3), rotation: floats(4), opacity: floats(1), colour: floats(3), velocity: floats(3),
    peak: floats(1), duration: floats(1, Infinity), cycle: floats(1, -1), least: floats(1), object: new Int32Array(count).fill(-1),
    reach: floats(1), slot: new Int32Array(count).fill(-1),
    harmonics: new Float32Array(rest * withHarmonics.reduce((sum, part) => sum + part.count, 0)),
  };
  let [begin, first, slot] = [0, 0, 0];
  for (const part of parts) {
    const { kind, cycle, least, objects } = part.motion;
    for (const array of part.arrays) {
      const end = begin + rowBytes(array) * part.count;
      const own = bytes.subarray(begin, end);
      begin = end;
      if (array.name === "harmonics") {
        scene.harmonics.set(decoded(array, part.count, own), rest * slot);
        for (let index = 0; index < part.count; index++) scene.slot[first + index] = slot++;
      } else if (array.name === "object") {
        const numbers = decoded(array, part.count, own);
        numbers.forEach((number, index) => {
          const object = Math.round(number);
          if (!(object >= 0 && object < objects.length)) refuse("has the number of an object that is not there");
          scene.object[first + index] = scene.objects.length + object;
        });
      } else if (array.name in WIDTHS) scene[array.name].set(decoded(array, part.count, own), array.width * first);
    }
    if (kind === "linear" || kind === "periodic") {
      scene.cycle.fill(kind === "linear" ? 0 : cycle, first, first + part.count);
      scene.least.fill(least || 0, first, first + part.count);
    }
    scene.objects.push(...(objects || []));
    first += part.count;
  }
  for (let index = 0; index < count; index++) {
    const [x, y, z] = scene.size.subarray(3 * index, 3 * index + 3);
    scene.reach[index] = Math.max(x, y, z);
    for (let channel = 3 * index; channel < 3 * index + 3; channel++) scene.colour[channel] = 0.5 + 0.28209479 * scene.colour[channel];
  }
  const all = [scene.position, scene.size, scene.rotation, scene.opacity, scene.colour, scene.velocity, scene.peak];
  if (all.some((values) => values.some((value) => !Number.isFinite(value)))) refuse("has a number that is not finite");
  if (scene.size.some((size) => size < 0) || scene.duration.some((duration) => !(duration > 0))) refuse("has a negative size or duration");
  return scene;
}

// Rendering.

const TEXELS = 3;
const ROW = 4096;
const SHIFT = Math.log2(ROW);
const ANYWHERE = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
// First a texel for each visible Gaussian: its centre in pixels, and packed halves: an axis, the ratio of the axes, and
// the opacity. Vertices would compute all of it four times.
const PROJECTED = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
uniform sampler2D objects;
uniform usampler2D scene, order;
uniform mat3 camera;
uniform vec3 eye;
uniform vec2 focal, viewport;
uniform float time, near;
uniform int visible;
out uvec4 projected;
uvec4 row(int texel) { return texelFetch(scene, ivec2(texel & ${ROW - 1}, texel >> ${SHIFT}), 0); }
vec3 turned(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
void main() {
  projected = uvec4(0);
  ivec2 texel = ivec2(gl_FragCoord.xy);
  if (texel.y * ${ROW} + texel.x >= visible) return;
  int first = int(texelFetch(order, texel, 0).x) * ${TEXELS};
  uvec4 a = row(first), b = row(first + 1);
  vec3 centre = uintBitsToFloat(a.xyz);
  vec2 sizes = unpackHalf2x16(b.x), more = unpackHalf2x16(b.y), last = unpackHalf2x16(b.w);
  vec4 q = vec4(more.y, unpackHalf2x16(b.z), last.x);
  float alpha = last.y;
  uint kind = a.w >> 30;
  if (kind == 2u) {
    int object = 2 * int(a.w & 65535u);
    vec4 at = texelFetch(objects, ivec2(object, 0), 0), r = texelFetch(objects, ivec2(object + 1, 0), 0);
    alpha *= at.w;
    centre = turned(r, centre) + at.xyz;
    q = vec4(r.w * q.xyz + q.w * r.xyz + cross(r.xyz, q.xyz), r.w * q.w - dot(r.xyz, q.xyz));
  } else if (kind == 1u) {
    uvec4 m = row(first + 2);
    vec2 rest = unpackHalf2x16(m.y);
    float d = time - uintBitsToFloat(m.z), cycle = uintBitsToFloat(m.w), ratio = d * rest.y, share = exp(-0.5 * ratio * ratio);
    alpha *= share > unpackHalf2x16(a.w & 65535u).x ? share : 0.0;
    float way = d;
    if (cycle > 0.0) { float turns = d / cycle; way = cycle * 0.15915494 * sin(6.2831853 * (turns - round(turns))); }
    centre += vec3(unpackHalf2x16(m.x), rest.x) * way;
  }
  vec3 c = camera * (centre - eye);
  if (alpha < 0.00393 || c.z < near) return;
  vec3 p = q.xyz * q.xyz, o = q.yzx * q.zxy, w = q.w * q.xyz;
  mat3 axes = camera * mat3(
    sizes.x * vec3(1.0 - 2.0 * (p.y + p.z), 2.0 * (o.z + w.z), 2.0 * (o.y - w.y)),
    sizes.y * vec3(2.0 * (o.z - w.z), 1.0 - 2.0 * (p.x + p.z), 2.0 * (o.x + w.x)),
    more.x * vec3(2.0 * (o.y + w.y), 2.0 * (o.x - w.x), 1.0 - 2.0 * (p.x + p.y)));
  vec2 widest = 0.65 * viewport / focal;
  vec2 slope = clamp(c.xy / c.z, -widest, widest);
  vec3 u = vec3(axes[0].x, axes[1].x, axes[2].x) - slope.x * vec3(axes[0].z, axes[1].z, axes[2].z);
  vec3 v = vec3(axes[0].y, axes[1].y, axes[2].y) - slope.y * vec3(axes[0].z, axes[1].z, axes[2].z);
  u *= focal.x / c.z;
  v *= focal.y / c.z;
  // The covariance in pixels, and its longer axis.
  float xx = dot(u, u) + 0.3, yy = dot(v, v) + 0.3, xy = dot(u, v);
  float middle = 0.5 * (xx + yy), apart = length(vec2(0.5 * (xx - yy), xy));
  float longest = middle + apart, shortest = max(middle - apart, 0.1);
  vec2 axis = abs(xy) > 1e-6 * middle ? normalize(vec2(xy, longest - xx)) : xx > yy ? vec2(1, 0) : vec2(0, 1);
  float ratio = sqrt(shortest / longest);
  axis *= min(sqrt(longest), 1024.0);
  projected = uvec4(floatBitsToUint(c.xy / c.z * focal), packHalf2x16(axis), packHalf2x16(vec2(ratio, alpha)));
}`;
const VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
uniform usampler2D order, gaussians;
uniform vec2 viewport;
out vec2 place;
flat out vec4 tint;
void main() {
  // A triangle around each: software renderers draw instances one by one, and a square has more vertices.
  int number = gl_VertexID / 3, corner = gl_VertexID - 3 * number;
  ivec2 texel = ivec2(number & ${ROW - 1}, number >> ${SHIFT});
  uvec4 gaussian = texelFetch(gaussians, texel, 0);
  vec2 axis = unpackHalf2x16(gaussian.z), more = unpackHalf2x16(gaussian.w);
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (more.y == 0.0) return;
  uint colour = texelFetch(order, texel, 0).y;
  // Up to an alpha of 1/255, or an eighth of a thousandth of the weight beyond.
  place = sqrt(clamp(2.0 * log(255.0 * more.y), 0.0, 8.0)) * (corner == 0 ? vec2(0, 2) : vec2(corner == 1 ? 1.7320508 : -1.7320508, -1));
  vec2 pixel = uintBitsToFloat(gaussian.xy) + place.x * axis + place.y * more.x * vec2(-axis.y, axis.x);
  gl_Position = vec4(vec2(2.0, -2.0) * pixel / viewport, 0.0, 1.0);
  tint = vec4(vec3((uvec3(colour) >> uvec3(0, 8, 16)) & 255u) / 255.0, more.y);
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec2 place;
flat in vec4 tint;
out vec4 colour;
void main() {
  float alpha = tint.a * exp(-0.5 * dot(place, place));
  colour = vec4(tint.rgb * alpha, alpha);
}`;

const canvas = document.querySelector("canvas");
// A graphics card draws; without one, or for the address #worker, the worker does. #webgl takes WebGL in any case.
function graphics() {
  if (location.hash === "#worker") return null;
  const options = { antialias: false, alpha: false, depth: false, powerPreference: "high-performance" };
  const probe = document.createElement("canvas").getContext("webgl2");
  const named = probe && probe.getExtension("WEBGL_debug_renderer_info");
  const name = probe ? probe.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : probe.RENDERER) : "";
  if (!probe || (/swiftshader|llvmpipe|software|basic render/i.test(name) && location.hash !== "#webgl")) return null;
  return canvas.getContext("webgl2", options);
}
const gl = graphics();
const flat = gl ? null : canvas.getContext("2d", { alpha: false });
state.draws = gl ? "webgl" : "worker";

function programOf(vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

function texture([width, height], [kind, channels, type], values) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, kind, width, height, 0, channels, type, values);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  return made;
}

// Objects lie in one line of a texture.
const MOST_OBJECTS = 1024;
// Returns bits of a number as a half, of magnitudes that it holds.
const number32 = new Float32Array(1);
const bits32 = new Uint32Array(number32.buffer);
function half(value) {
  number32[0] = Math.max(-65504, Math.min(65504, value));
  const bits = bits32[0];
  const sign = bits >>> 16 & 0x8000;
  const exponent = (bits >>> 23 & 255) - 112;
  if (exponent <= 0) return exponent < -10 ? sign : sign | (0x800000 | bits & 0x7fffff) >> 14 - exponent;
  return sign | (exponent << 10 | bits >>> 13 & 0x3ff);
}
// Rows of the scene's texture: place and kind; halves of sizes, rotation and opacity; motion.
function packedRows(scene, height) {
  const { position, size, rotation, opacity, velocity, peak, duration, cycle, least, object } = scene;
  const rows = new Uint32Array(4 * ROW * height);
  const floats = new Float32Array(rows.buffer);
  const two = (low, high) => half(low) | half(high) << 16;
  for (let i = 0; i < scene.count; i++) {
    const to = 4 * TEXELS * i;
    const [at, q] = [3 * i, 4 * i];
    const length = Math.hypot(rotation[q], rotation[q + 1], rotation[q + 2], rotation[q + 3]) || 1;
    // In the file w is the first.
    const [w, x, y, z] = [rotation[q] / length, rotation[q + 1] / length, rotation[q + 2] / length, rotation[q + 3] / length];
    for (let axis = 0; axis < 3; axis++) floats[to + axis] = position[at + axis];
    rows[to + 3] = object[i] >= 0 ? 2 << 30 | object[i] : cycle[i] >= 0 ? 1 << 30 | half(least[i]) : 0;
    rows[to + 4] = two(size[at], size[at + 1]);
    rows[to + 5] = two(size[at + 2], x);
    rows[to + 6] = two(y, z);
    rows[to + 7] = two(w, opacity[i]);
    rows[to + 8] = two(velocity[at], velocity[at + 1]);
    rows[to + 9] = two(velocity[at + 2], 1 / duration[i]);
    floats[to + 10] = peak[i];
    floats[to + 11] = cycle[i];
  }
  return rows;
}

function texturesOf(scene) {
  const height = Math.ceil(TEXELS * scene.count / ROW);
  if (height > gl.getParameter(gl.MAX_TEXTURE_SIZE)) refuse(`has ${scene.count} Gaussians, more than a texture holds`);
  if (scene.objects.length > MOST_OBJECTS) refuse(`has ${scene.objects.length} objects`);
  const lines = Math.ceil(scene.count / ROW);
  const integers = [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT];
  return {
    scene: texture([ROW, height], integers, packedRows(scene, height)),
    order: texture([ROW, lines], [gl.RG32UI, gl.RG_INTEGER, gl.UNSIGNED_INT], null),
    gaussians: texture([ROW, lines], integers, null),
    objects: texture([2 * Math.max(1, scene.objects.length), 1], [gl.RGBA32F, gl.RGBA, gl.FLOAT], null),
  };
}

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
const LEAST_SHARE = 0.3;
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
