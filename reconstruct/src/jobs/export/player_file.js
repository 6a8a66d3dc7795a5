// Plays Gaussians in time (docs/reference/gaussians-in-time.md). Three files make one script: the reader of a file,
// the drawing on a graphics card (player_webgl.js), and the player (player.js).
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
    if (part.motion.kind === "rigid" && names.includes("harmonics")) refuse("has a rigid part with harmonics");
    if (!(part.count >= 0) || new Set(names).size !== names.length) refuse("has a part without a count, or a name twice");
    for (const array of part.arrays) {
      const expected = array.name === "harmonics" ? 3 * ((header.degree + 1) ** 2 - 1) : WIDTHS[array.name] || array.width;
      if (!(array.width > 0) || array.width !== expected) refuse(`has ${array.name} of width ${array.width}`);
      const isKnown = array.type in BYTES && [undefined, "linear", "exp"].includes(array.map);
      const isBounded = array.type === "f32" || ([array.low, array.high].every((bounds) => bounds && bounds.length === array.width && bounds.every(Number.isFinite))
        && array.low.every((low, column) => low <= array.high[column]));
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
  if (scene.opacity.some((opacity) => opacity < 0 || opacity > 1)) refuse("has an opacity that is not in [0, 1]");
  if (scene.size.some((size) => size < 0) || scene.duration.some((duration) => !(duration > 0))) refuse("has a negative size or duration");
  arrange(scene);
  return scene;
}

// Puts Gaussians that are close together beside each other, in place and in time: those at rest, those in time, each
// object's. What a view does not see is then left out in blocks.
function arrange(scene) {
  const { count, position, peak, cycle, object } = scene;
  if (count > 2 ** 24) return;
  const axes = [0, 1, 2].map((axis) => (i) => position[3 * i + axis]).concat((i) => peak[i]);
  const ranges = axes.map((value) => {
    let [low, high] = [Infinity, -Infinity];
    for (let i = 0; i < count; i++) { low = Math.min(low, value(i)); high = Math.max(high, value(i)); }
    return [low, high - low || 1];
  });
  // The bits of a cell, every fourth of a key.
  const apart = Array.from({ length: 32 }, (_, cell) => [0, 1, 2, 3, 4].reduce((bits, bit) => bits | (cell >> bit & 1) << 4 * bit, 0));
  const keys = new Float64Array(count);
  for (let i = 0; i < count; i++) {
    let key = 0;
    axes.forEach((value, axis) => { key |= apart[Math.floor(31.99 * (value(i) - ranges[axis][0]) / ranges[axis][1])] << axis; });
    const group = object[i] >= 0 ? 2 + Math.min(object[i], 253) : cycle[i] >= 0 ? 1 : 0;
    keys[i] = (group * 2 ** 20 + key) * 2 ** 24 + i;
  }
  keys.sort();
  const rows = keys.map((key) => key % 2 ** 24);
  for (const [name, width] of Object.entries({ ...WIDTHS, cycle: 1, least: 1, reach: 1, slot: 1 })) {
    const from = scene[name];
    const to = scene[name] = new from.constructor(from.length);
    for (let at = 0; at < count; at++) for (let column = 0; column < width; column++) to[width * at + column] = from[width * rows[at] + column];
  }
}
