// Worker: the Gaussians that are visible at a moment, from far to near, with their colours from the camera's place.
// The page computes the same motion for every frame; here it is computed as often as the order matters.

// Time over which an order is used, seconds: who appears within it is in it.
const AHEAD = 0.15;
const LEAST = 1 / 255;
const KEYS = 65536;
let scene = null;

// Pose of an object: [x, y, z, qx, qy, qz, qw], or null before and after its track.
function poseOf(object, time) {
  const { times, positions, rotations } = object;
  const last = times.length - 1;
  if (!(time >= times[0] && time <= times[last])) return null;
  let piece = 0;
  for (let low = 0, high = last; high - low > 1;) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) piece = low = middle; else high = middle;
  }
  const u = (time - times[piece]) / (times[piece + 1] - times[piece]);
  const v = 1 - u;
  const weights = [v * v * v, 3 * u * v * v, 3 * u * u * v, u * u * u];
  const place = [0, 1, 2].map((axis) => weights.reduce((sum, weight, at) => sum + weight * positions[3 * piece + at][axis], 0));
  const unit = (q) => q.map((part) => part / Math.hypot(...q));
  const from = unit(rotations[piece]);
  let to = unit(rotations[piece + 1]);
  let dot = from.reduce((sum, part, at) => sum + part * to[at], 0);
  if (dot < 0) { to = to.map((part) => -part); dot = -dot; }
  const angle = Math.acos(Math.min(1, dot));
  const share = angle < 1e-4 ? [v, u] : [Math.sin(v * angle) / Math.sin(angle), Math.sin(u * angle) / Math.sin(angle)];
  const [w, x, y, z] = unit(from.map((part, at) => share[0] * part + share[1] * to[at]));
  return [...place, x, y, z, w];
}

// Adds the harmonics in a direction to the constant colour, as 8 bits for each channel.
function colourOf(index, x, y, z, degree) {
  const { colour, harmonics } = scene;
  let [red, green, blue] = [colour[3 * index], colour[3 * index + 1], colour[3 * index + 2]];
  if (degree > 0 && harmonics[scene.slot[index] * scene.rest] !== undefined) {
    const basis = scene.basis;
    const length = 1 / (Math.hypot(x, y, z) || 1);
    x *= length; y *= length; z *= length;
    basis[0] = -0.48860251 * y; basis[1] = 0.48860251 * z; basis[2] = -0.48860251 * x;
    if (degree > 1) {
      basis[3] = 1.09254843 * x * y; basis[4] = -1.09254843 * y * z; basis[5] = 0.31539157 * (2 * z * z - x * x - y * y);
      basis[6] = -1.09254843 * x * z; basis[7] = 0.54627422 * (x * x - y * y);
    }
    if (degree > 2) {
      basis[8] = -0.59004359 * y * (3 * x * x - y * y); basis[9] = 2.89061144 * x * y * z;
      basis[10] = -0.4570458 * y * (4 * z * z - x * x - y * y); basis[11] = 0.37317633 * z * (2 * z * z - 3 * x * x - 3 * y * y);
      basis[12] = -0.4570458 * x * (4 * z * z - x * x - y * y); basis[13] = 1.44530572 * z * (x * x - y * y);
      basis[14] = -0.59004359 * x * (x * x - 3 * y * y);
    }
    let at = scene.slot[index] * scene.rest;
    for (let k = 0; 3 * k < scene.rest; k++, at += 3) {
      red += basis[k] * harmonics[at]; green += basis[k] * harmonics[at + 1]; blue += basis[k] * harmonics[at + 2];
    }
  }
  const byte = (value) => (value <= 0 ? 0 : value >= 1 ? 255 : Math.round(255 * value));
  return byte(red) | byte(green) << 8 | byte(blue) << 16 | 255 << 24;
}

function order({ time, eye, right, down, ahead, tangents }, buffer) {
  const { count, position, reach, opacity, velocity, peak, duration, cycle, least, object, objects, degree } = scene;
  const { depth, bits, found, away } = scene;
  const poses = objects.map((each) => poseOf(each, time));
  let visible = 0;
  let [nearest, farthest] = [0xffffffff, 0];
  for (let i = 0; i < count; i++) {
    let [x, y, z] = [position[3 * i], position[3 * i + 1], position[3 * i + 2]];
    let alpha = opacity[i];
    const of = object[i];
    if (of >= 0) {
      const pose = poses[of];
      if (pose === null) continue;
      const [cx, cy, cz, a, b, c, w] = pose;
      const [s, t, u] = [2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)];
      x += w * s + b * u - c * t + cx; y += w * t + c * s - a * u + cy; z += w * u + a * t - b * s + cz;
    } else if (cycle[i] >= 0) {
      const d = time - peak[i];
      if (duration[i] < Infinity) {
        const nearestD = d > 0 ? d : Math.min(0, d + AHEAD);
        const share = Math.exp(-0.5 * (nearestD / duration[i]) ** 2);
        alpha = share > least[i] ? alpha * share : 0;
      }
      const way = cycle[i] === 0 ? d : cycle[i] / (2 * Math.PI) * Math.sin(2 * Math.PI * d / cycle[i]);
      x += velocity[3 * i] * way; y += velocity[3 * i + 1] * way; z += velocity[3 * i + 2] * way;
    }
    if (alpha < LEAST) continue;
    x -= eye[0]; y -= eye[1]; z -= eye[2];
    const forward = x * ahead[0] + y * ahead[1] + z * ahead[2];
    const margin = 3 * reach[i];
    if (forward <= 0 || forward + margin < scene.near) continue;
    // A margin for turns of the camera until the next order.
    const [across, along] = [x * right[0] + y * right[1] + z * right[2], x * down[0] + y * down[1] + z * down[2]];
    if (Math.abs(across) > 1.2 * tangents[0] * forward + margin || Math.abs(along) > 1.2 * tangents[1] * forward + margin) continue;
    depth[visible] = forward;
    // Bits of a positive float rise with it.
    const key = bits[visible];
    if (key < nearest) nearest = key;
    if (key > farthest) farthest = key;
    if (degree > 0) { away[3 * visible] = x; away[3 * visible + 1] = y; away[3 * visible + 2] = z; }
    found[visible++] = i;
  }
  const out = new Uint32Array(buffer);
  let shift = 0;
  while (visible > 0 && (farthest - nearest) / 2 ** shift >= KEYS) shift++;
  const counts = scene.counts.fill(0);
  for (let at = 0; at < visible; at++) counts[(farthest - bits[at]) >>> shift]++;
  for (let key = 0, sum = 0; key < KEYS; key++) { const here = counts[key]; counts[key] = sum; sum += here; }
  for (let at = 0; at < visible; at++) {
    const to = 2 * counts[(farthest - bits[at]) >>> shift]++;
    const i = found[at];
    out[to] = i;
    out[to + 1] = degree === 0 ? scene.bytes[i]
      : colourOf(i, away[3 * at], away[3 * at + 1], away[3 * at + 2], degree);
  }
  return visible;
}

function answer({ data }) {
  if (data.scene) {
    scene = data.scene;
    const { count } = scene;
    scene.depth = new Float32Array(count);
    scene.bits = new Uint32Array(scene.depth.buffer);
    scene.found = new Uint32Array(count);
    scene.counts = new Uint32Array(KEYS);
    scene.basis = new Float32Array(15);
    const isFlat = scene.degree === 0;
    // Directions to the visible ones.
    scene.away = new Float32Array(isFlat ? 0 : 3 * count);
    scene.bytes = Uint32Array.from({ length: isFlat ? count : 0 }, (_, index) => colourOf(index, 0, 0, 1, 0));
    return;
  }
  const begun = performance.now();
  const visible = order(data.view, data.buffer);
  postMessage({ visible, buffer: data.buffer, milliseconds: performance.now() - begun }, [data.buffer]);
}
// The page takes poses of objects from this text too.
if (typeof document === "undefined") onmessage = answer;
