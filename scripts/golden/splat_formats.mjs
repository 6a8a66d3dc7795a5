#!/usr/bin/env node
// Files of another program, for the test `files_of_a_peer_are_read` of `formats/exchange/tests.rs`.
//
// usage: scripts/golden/splat_formats.mjs NODE_MODULES FOLDER
//
// Six Gaussians with harmonics of degree 3 in every format that @playcanvas/splat-transform (2.7.1) writes, and as a
// PLY of 3DGS whose bytes are written here. NODE_MODULES is the folder that npm installed the package into.
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [modules, folder] = process.argv.slice(2);
const entry = path.resolve(modules, "@playcanvas/splat-transform/dist/index.mjs");
const peer = await import(pathToFileURL(entry));

const COUNT = 6;
const names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
for (let index = 0; index < 45; index++) names.push(`f_rest_${index}`);
names.push("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3");

const wave = (number, pace) => Math.sin(0.3 + pace * number);
function value(name, column, row) {
  const [kind, axis] = [name.replace(/_\d+$/, ""), Number(name.at(-1))];
  if ("xyz".includes(name)) return 3 * wave(row, 0.7 + 0.31 * column);
  if (name.startsWith("n")) return 0;
  if (kind === "f_dc") return 1.5 * wave(row, 0.11 + 0.2 * axis);
  if (kind === "f_rest") return 0.8 * wave(row, 0.05 * column);
  if (kind === "opacity") return 2.5 * wave(row, 1.9);
  if (kind === "scale") return -3 + wave(row, 0.9 + axis);
  // The first four are poles.
  return row < 4 ? Number(row === axis) : wave(row, 0.4 + 0.3 * axis);
}

const columns = names.map((name, column) => {
  const values = Array.from({ length: COUNT }, (_, row) => value(name, column, row));
  return new Float32Array(values);
});
for (let row = 0; row < COUNT; row++) {
  const turn = columns.slice(-4);
  const length = Math.hypot(...turn.map((part) => part[row]));
  for (const part of turn) part[row] /= length;
}

/** A PLY of 3DGS from columns of floats by name. */
function ply(names, columns) {
  const header = ["ply", "format binary_little_endian 1.0", `element vertex ${COUNT}`];
  for (const name of names) header.push(`property float ${name}`);
  const rows = new Float32Array(COUNT * names.length);
  rows.forEach((_, at) => (rows[at] = columns[at % names.length][Math.floor(at / names.length)]));
  return Buffer.concat([Buffer.from(header.join("\n") + "\nend_header\n"), Buffer.from(rows.buffer)]);
}
fs.writeFileSync(path.join(folder, "source.ply"), ply(names, columns));

const kept = names.map((name, at) => new peer.Column(name, columns[at])).filter(({ name }) => !/^n.$/.test(name));
const table = new peer.DataTable(kept, peer.Transform.PLY);
async function write(file, writer, options = {}) {
  const memory = new peer.MemoryFileSystem();
  await writer({ filename: file, dataTable: table, ...options }, memory);
  fs.writeFileSync(path.join(folder, file), memory.results.get(file));
}
await write("version-3.spz", peer.writeSpz, { version: 3 });
await write("version-4.spz", peer.writeSpz, { version: 4 });
await write("peer.compressed.ply", peer.writeCompressedPly);
await write("peer.glb", peer.writeGlb);
await write("peer.sog", peer.writeSog, { bundle: true, iterations: 10 });

// Its palette has fewer rows than there are Gaussians: what it reads of it is the truth of the test.
const files = new peer.MemoryReadFileSystem();
files.set("peer.sog", new Uint8Array(fs.readFileSync(path.join(folder, "peer.sog"))));
const archive = new peer.ZipReadFileSystem(await files.createSource("peer.sog"));
const { columns: read } = await peer.readSog(archive, "meta.json");
const readColumns = read.map(({ data }) => data);
fs.writeFileSync(path.join(folder, "read-sog.ply"), ply(read.map(({ name }) => name), readColumns));
