// Worker: the Gaussians that are visible at a moment, from far to near, with their colours from the camera's place.
// The page computes the same motion for every frame; here it is computed as often as the order matters. Without a
// graphics card the worker draws too: a software renderer of WebGL takes a microsecond for each triangle.

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

// Rotation matrix of a unit quaternion, row by row.
function matrixOf(x, y, z, w) {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}

// Covariances: xx, xy, xz, yy, yz, zz of each.
function spreads({ count, size, rotation }) {
  const all = new Float32Array(6 * count);
  for (let i = 0; i < count; i++) {
    const [w, x, y, z] = rotation.subarray(4 * i, 4 * i + 4);
    const length = Math.hypot(w, x, y, z) || 1;
    const m = matrixOf(x / length, y / length, z / length, w / length);
    let at = 6 * i;
    for (let row = 0; row < 3; row++) {
      for (let column = row; column < 3; column++, at++) {
        for (let axis = 0; axis < 3; axis++) all[at] += m[3 * row + axis] * m[3 * column + axis] * size[3 * i + axis] ** 2;
      }
    }
  }
  return all;
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

// Number of neighbours that are left out together.
const BLOCK = 64;
// Bounds of each block: a sphere around its centres wherever they move (x, y, z, radius), three times the largest reach,
// the first and the last time at which one is visible, and the object, -1 without, NaN for several.
const BOUNDS = 8;
function bounds({ count, position, reach, velocity, peak, lasting, cycle, object }) {
  const all = new Float64Array(BOUNDS * Math.ceil(count / BLOCK));
  for (let begin = 0, to = 0; begin < count; begin += BLOCK, to += BOUNDS) {
    const end = Math.min(count, begin + BLOCK);
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    let moved = 0, margin = 0, first = Infinity, last = -Infinity, of = object[begin];
    for (let i = begin; i < end; i++) {
      const isInTime = cycle[i] >= 0;
      if (object[i] !== of) of = NaN;
      if (lasting[i] < 0) continue;
      for (let axis = 0; axis < 3; axis++) {
        low[axis] = Math.min(low[axis], position[3 * i + axis]);
        high[axis] = Math.max(high[axis], position[3 * i + axis]);
      }
      margin = Math.max(margin, 3 * reach[i]);
      first = Math.min(first, isInTime ? peak[i] - lasting[i] : -Infinity);
      last = Math.max(last, isInTime ? peak[i] + lasting[i] : Infinity);
      const speed = isInTime ? Math.hypot(velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]) : 0;
      if (speed > 0) moved = Math.max(moved, speed * (cycle[i] > 0 ? cycle[i] / (2 * Math.PI) : lasting[i]));
    }
    const centre = low.map((value, axis) => (value + high[axis]) / 2);
    all.set([...centre, Math.hypot(...low.map((value, axis) => high[axis] - value)) / 2 + moved, margin, first, last, of], to);
  }
  return all;
}

function order({ time, eye, right, down, ahead, tangents, later }, buffer) {
  const { count, position, reach, velocity, peak, lasting, cycle, object, objects, degree, near } = scene;
  const { distance, bits, found, away, slots, blocks } = scene;
  const poses = objects.map((each) => poseOf(each, time));
  const turns = poses.map((pose) => pose && matrixOf(...pose.slice(3)));
  const [ex, ey, ez] = eye;
  const [rx, ry, rz] = right;
  const [dx, dy, dz] = down;
  const [ax, ay, az] = ahead;
  const [across, top, bottom] = tangents;
  let visible = 0;
  let nearest = 0xffffffff;
  let farthest = 0;
  const isOutside = (at) => {
    if (time < blocks[at + 5] - later || time > blocks[at + 6]) return true;
    let x = blocks[at], y = blocks[at + 1], z = blocks[at + 2];
    const radius = blocks[at + 3], margin = blocks[at + 4], of = blocks[at + 7];
    if (!(of < 0)) {
      const pose = poses[of];
      if (!pose) return pose === null;
      const m = turns[of];
      [x, y, z] = [m[0] * x + m[1] * y + m[2] * z + pose[0], m[3] * x + m[4] * y + m[5] * z + pose[1], m[6] * x + m[7] * y + m[8] * z + pose[2]];
    }
    x -= ex; y -= ey; z -= ez;
    const forward = x * ax + y * ay + z * az;
    const lower = x * dx + y * dy + z * dz;
    const slack = (slope) => margin + radius * (1 + Math.abs(slope));
    return forward + radius <= near || lower < top * forward - slack(top) || lower > bottom * forward + slack(bottom)
      || Math.abs(x * rx + y * ry + z * rz) > across * forward + slack(across);
  };
  for (let i = 0; i < count; i++) {
    while (i < count && i % BLOCK === 0 && isOutside(BOUNDS * i / BLOCK)) i += BLOCK;
    if (i >= count) break;
    const limit = lasting[i];
    const isInTime = cycle[i] >= 0;
    const d = time - peak[i];
    // Negative for those that are transparent at all times.
    if (limit < 0 || (isInTime && (d > limit || d + later < -limit))) continue;
    let x = position[3 * i];
    let y = position[3 * i + 1];
    let z = position[3 * i + 2];
    if (object[i] >= 0) {
      const pose = poses[object[i]];
      if (pose === null) continue;
      const a = pose[3], b = pose[4], c = pose[5], w = pose[6];
      const s = 2 * (b * z - c * y), t = 2 * (c * x - a * z), u = 2 * (a * y - b * x);
      x += w * s + b * u - c * t + pose[0]; y += w * t + c * s - a * u + pose[1]; z += w * u + a * t - b * s + pose[2];
    } else if (isInTime) {
      const way = cycle[i] === 0 ? d : cycle[i] / (2 * Math.PI) * Math.sin(2 * Math.PI * d / cycle[i]);
      x += velocity[3 * i] * way; y += velocity[3 * i + 1] * way; z += velocity[3 * i + 2] * way;
    }
    x -= ex; y -= ey; z -= ez;
    const squared = x * x + y * y + z * z;
    // A Gaussian longer than its distance has no shape in the image: the renderer leaves it out too.
    if (squared <= reach[i] * reach[i]) continue;
    const forward = x * ax + y * ay + z * az;
    const margin = 3 * reach[i];
    const lower = x * dx + y * dy + z * dz;
    if (forward <= near || lower < top * forward - margin || lower > bottom * forward + margin
        || Math.abs(x * rx + y * ry + z * rz) > across * forward + margin) continue;
    // By distance, as the renderer does: Gaussians beside the image are far, though they have little depth.
    distance[visible] = Math.sqrt(squared);
    // Bits of a positive float rise with it.
    const key = bits[visible];
    if (key < nearest) nearest = key;
    if (key > farthest) farthest = key;
    away[3 * visible] = x; away[3 * visible + 1] = y; away[3 * visible + 2] = z;
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
    slots[to >> 1] = at;
    out[to + 1] = degree === 0 ? scene.bytes[i]
      : colourOf(i, away[3 * at], away[3 * at + 1], away[3 * at + 2], degree);
  }
  return visible;
}

// exp(-p / 2) up to p = 8.
const STEPS = 64;
const FALL = Float32Array.from({ length: 8 * STEPS + 2 }, (_, step) => Math.exp(-0.5 * (step + 0.5) / STEPS));
// A pixel that lets less light through is full.
const FULL = 1 / 255;

// Projects the visible Gaussians in the order of the file, whose arrays are then read in a row: centre in pixels,
// covariance (a, b; b, c), opacity, and the largest squared distance, in 8 numbers each.
function project(view, visible) {
  const { width, height, focal, time, right, down, ahead } = view;
  const { spread, logarithm, opacity, peak, duration, cycle, object, objects, away, found, projected } = scene;
  const turns = objects.map((each) => { const pose = poseOf(each, time); return pose && matrixOf(...pose.slice(3)); });
  const [rx, ry, rz] = right;
  const [dx, dy, dz] = down;
  const [ax, ay, az] = ahead;
  const limits = [0.65 * width / focal, 0.65 * height / focal];
  for (let slot = 0; slot < visible; slot++) {
    const i = found[slot];
    let alpha = opacity[i];
    let limit = logarithm[i];
    if (cycle[i] >= 0) {
      const ratio = (time - peak[i]) / duration[i];
      limit -= ratio * ratio;
      alpha *= Math.exp(-0.5 * ratio * ratio);
    }
    const x = away[3 * slot], y = away[3 * slot + 1], z = away[3 * slot + 2];
    const cz = x * ax + y * ay + z * az;
    const scale = focal / cz;
    const px = (x * rx + y * ry + z * rz) / cz;
    const py = (x * dx + y * dy + z * dz) / cz;
    const sx = Math.max(-limits[0], Math.min(limits[0], px));
    const sy = Math.max(-limits[1], Math.min(limits[1], py));
    // Gradients of a pixel's place, in the scene's axes.
    let gx = scale * (rx - sx * ax), gy = scale * (ry - sx * ay), gz = scale * (rz - sx * az);
    let hx = scale * (dx - sy * ax), hy = scale * (dy - sy * ay), hz = scale * (dz - sy * az);
    if (object[i] >= 0) {
      // Into the axes of the object.
      const m = turns[object[i]];
      const ox = gx, oy = gy, oz = gz, px = hx, py = hy, pz = hz;
      gx = m[0] * ox + m[3] * oy + m[6] * oz; gy = m[1] * ox + m[4] * oy + m[7] * oz; gz = m[2] * ox + m[5] * oy + m[8] * oz;
      hx = m[0] * px + m[3] * py + m[6] * pz; hy = m[1] * px + m[4] * py + m[7] * pz; hz = m[2] * px + m[5] * py + m[8] * pz;
    }
    const xx = spread[6 * i], xy = spread[6 * i + 1], xz = spread[6 * i + 2], yy = spread[6 * i + 3], yz = spread[6 * i + 4], zz = spread[6 * i + 5];
    const kx = xx * gx + xy * gy + xz * gz, ky = xy * gx + yy * gy + yz * gz, kz = xz * gx + yz * gy + zz * gz;
    const to = 8 * slot;
    projected[to] = px * focal + 0.5 * width - 0.5;
    projected[to + 1] = py * focal + 0.5 * height - 0.5;
    projected[to + 2] = kx * gx + ky * gy + kz * gz + 0.3;
    projected[to + 3] = kx * hx + ky * hy + kz * hz;
    projected[to + 4] = hx * (xx * hx + 2 * (xy * hy + xz * hz)) + hy * (yy * hy + 2 * yz * hz) + zz * hz * hz + 0.3;
    projected[to + 5] = alpha;
    projected[to + 6] = limit > 8 ? 8 : limit;
  }
}

// Draws the visible Gaussians from near to far; returns pixels of 8 bits.
function picture(view, visible, entries) {
  const { width, lines: [begin, end] } = view;
  project(view, visible);
  const { projected, slots } = scene;
  const area = width * (end - begin);
  // Light of three colours, and the share that is let through.
  const light = new Float32Array(4 * area);
  for (let at = 3; at < light.length; at += 4) light[at] = 1;
  for (let turn = visible - 1; turn >= 0; turn--) {
    const from = 8 * slots[turn];
    const centreX = projected[from], centreY = projected[from + 1];
    const a = projected[from + 2], b = projected[from + 3], c = projected[from + 4];
    const alpha = projected[from + 5], limit = projected[from + 6];
    const determinant = a * c - b * b;
    if (!(determinant > 0)) continue;
    const A = c / determinant, B = -b / determinant, C = a / determinant;
    const tall = Math.sqrt(limit * c);
    const slant = b / c, widest = limit * determinant / c, narrowing = determinant / (c * c);
    const bend = 2 * STEPS * A;
    const last = Math.min(end - 1, Math.floor(centreY + tall));
    const rgb = entries[2 * turn + 1];
    const red = rgb & 255, green = rgb >> 8 & 255, blue = rgb >> 16 & 255;
    for (let line = Math.max(begin, Math.ceil(centreY - tall)); line <= last; line++) {
      const v = line - centreY;
      // Where the line is within the ellipse.
      const middle = v * slant;
      const inside = widest - v * v * narrowing;
      if (!(inside >= 0)) continue;
      const half = Math.sqrt(inside);
      const right = Math.min(width - 1, Math.floor(centreX + middle + half));
      let column = Math.max(0, Math.ceil(centreX + middle - half));
      let w = column - centreX;
      let power = STEPS * (A * w * w + 2 * B * w * v + C * v * v);
      let rise = STEPS * (A * (2 * w + 1) + 2 * B * v);
      let pixel = 4 * ((line - begin) * width + column);
      for (; column <= right; column++, pixel += 4) {
        const rest = light[pixel + 3];
        if (rest > FULL) {
          const given = rest * alpha * FALL[power > 0 ? power | 0 : 0];
          light[pixel] += given * red;
          light[pixel + 1] += given * green;
          light[pixel + 2] += given * blue;
          light[pixel + 3] = rest - given;
        }
        power += rise;
        rise += bend;
      }
    }
  }
  const pixels = new Uint8ClampedArray(4 * area);
  for (let at = 0; at < light.length; at += 4) {
    pixels[at] = light[at];
    pixels[at + 1] = light[at + 1];
    pixels[at + 2] = light[at + 2];
    pixels[at + 3] = 255;
  }
  return pixels.buffer;
}

function answer({ data }) {
  if (data.scene) {
    scene = data.scene;
    const { count } = scene;
    scene.distance = new Float32Array(count);
    scene.bits = new Uint32Array(scene.distance.buffer);
    scene.found = new Uint32Array(count);
    scene.counts = new Uint32Array(KEYS);
    scene.logarithm = Float32Array.from(scene.opacity, (alpha) => 2 * Math.log(255 * alpha));
    if (data.draws) scene.spread = spreads(scene);
    // Time from a peak in which a Gaussian is visible.
    const { opacity, least, duration } = scene;
    scene.lasting = Float32Array.from(opacity, (alpha, index) => {
      const share = Math.max(LEAST / alpha, least[index]);
      return share > 1 ? -1 : duration[index] * Math.sqrt(-2 * Math.log(share));
    });
    scene.blocks = bounds(scene);
    scene.basis = new Float32Array(15);
    const isFlat = scene.degree === 0;
    // Places of the visible ones from the camera, and their order.
    scene.away = new Float32Array(3 * count);
    scene.slots = new Uint32Array(count);
    scene.projected = new Float32Array(data.draws ? 8 * count : 0);
    scene.bytes = Uint32Array.from({ length: isFlat ? count : 0 }, (_, index) => colourOf(index, 0, 0, 1, 0));
    return;
  }
  const begun = performance.now();
  const { view, buffer } = data;
  const visible = order(view, buffer);
  const milliseconds = performance.now() - begun;
  if (!view.lines) return postMessage({ visible, buffer, milliseconds }, [buffer]);
  const pixels = picture(view, visible, new Uint32Array(buffer));
  postMessage({ visible, buffer, milliseconds: performance.now() - begun, view, pixels }, [buffer, pixels]);
}
// The page takes poses of objects from this text too.
if (typeof document === "undefined") onmessage = answer;
