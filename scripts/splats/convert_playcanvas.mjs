// Reads a glTF binary of Gaussians with the engine PlayCanvas, without a graphics card, and writes a PLY of 3DGS.
//
// usage: convert_playcanvas.mjs NODE_MODULES FILE.glb OUT.ply
//
// NODE_MODULES is the folder that npm installed playcanvas into; splat-transform brings it. glTF has x left, y up and z
// forward, the PLY x right and y down: half a turn about z. A file that it refuses is one line.
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [modules, file, out] = process.argv.slice(2);
process.on("uncaughtException", (error) => {
  console.error(`convert_playcanvas: ${file}: ${error.message ?? error}`);
  process.exit(1);
});
const load = (name) => import(pathToFileURL(path.resolve(modules, "playcanvas/build/playcanvas/src", name)));
const { NullGraphicsDevice } = await load("platform/graphics/null/null-graphics-device.js");
const { GlbParser } = await load("framework/parsers/glb-parser.js");
const { khrGaussianSplatting } = await load("framework/parsers/glb/extensions/khr-gaussian-splatting.js");

const bytes = new Uint8Array(fs.readFileSync(file));
const read = await new Promise((resolve, reject) => {
  const done = (error, result) => (error ? reject(error) : resolve(result));
  const registry = { loader: { _app: null } };
  GlbParser.parse(file, "", bytes.buffer, new NullGraphicsDevice(), registry, {}, [khrGaussianSplatting], done);
});
const parts = read.gsplats.flat().filter(Boolean);
if (parts.length !== 1) throw new Error(`${parts.length} primitives of Gaussians, 1 expected`);
const [{ gsplatData: data }] = parts;
if (!data.activated) throw new Error("sizes and opacities are not linear");

const count = data.numSplats;
const column = (name) => data.getProp(name);
const rests = Array.from({ length: 45 }, (_, number) => `f_rest_${number}`).filter(column);
// Parities of the orders -1, 0, 1, -2, ... of harmonics: half a turn about z turns the sign of odd ones.
const isOdd = [1, 2, 3].flatMap((degree) => Array.from({ length: 2 * degree + 1 }, (_, at) => (at - degree) % 2 !== 0));
const signOf = (number) => (isOdd[number % (rests.length / 3)] ? -1 : 1);
const [w, x, y, z] = [0, 1, 2, 3].map((part) => column(`rot_${part}`));
const columns = {
  x: column("x").map((value) => -value),
  y: column("y").map((value) => -value),
  z: column("z"),
  ...Object.fromEntries([0, 1, 2].map((channel) => [`f_dc_${channel}`, column(`f_dc_${channel}`)])),
  ...Object.fromEntries(rests.map((name, number) => [name, column(name).map((value) => signOf(number) * value)])),
  opacity: column("opacity").map((value) => Math.log(value / (1 - value))),
  ...Object.fromEntries([0, 1, 2].map((axis) => [`scale_${axis}`, column(`scale_${axis}`).map(Math.log)])),
  rot_0: z.map((value) => -value),
  rot_1: y.map((value) => -value),
  rot_2: x,
  rot_3: w,
};
const names = Object.keys(columns);
const header = ["ply", "format binary_little_endian 1.0", `element vertex ${count}`];
const body = new Float32Array(count * names.length);
names.forEach((name, at) => {
  header.push(`property float ${name}`);
  columns[name].forEach((value, row) => (body[row * names.length + at] = value));
});
fs.writeFileSync(out, Buffer.concat([Buffer.from(`${header.join("\n")}\nend_header\n`), Buffer.from(body.buffer)]));
