// Drawing on a graphics card, in WebGL 2.

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
  float largest = max(max(sizes.x, sizes.y), more.x);
  if (alpha < 0.00393 || c.z < near || dot(c, c) <= largest * largest) return;
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
