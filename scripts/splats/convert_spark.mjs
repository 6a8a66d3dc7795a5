// Reads a file of Gaussians of degree 3 with Spark (2.2 stops at others) and writes what it read as SPZ.
//
// usage: convert_spark.mjs NODE_MODULES FILE OUT.spz
//
// NODE_MODULES is the folder that npm installed @sparkjsdev/spark and three into.
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [modules, file, out] = process.argv.slice(2);
// What the library asks of a browser when it is loaded.
globalThis.self ??= globalThis;
globalThis.document ??= { createElement: () => ({ getContext: () => null, style: {} }) };
globalThis.Worker ??= class {
  addEventListener() {}
  postMessage() {}
};
const entry = path.resolve(modules, "@sparkjsdev/spark/dist/spark.module.js");
const spark = await import(pathToFileURL(entry));
const input = { fileBytes: new Uint8Array(fs.readFileSync(file)), pathOrUrl: file };
for (let attempt = 0; ; attempt++) {
  try {
    const { fileBytes } = await spark.transcodeSpz({ inputs: [input], maxSh: 3, fractionalBits: 16 });
    fs.writeFileSync(out, fileBytes);
    process.exit(0);
  } catch (error) {
    // Its WebAssembly is not there at once, and nothing says when it is.
    if (attempt === 50 || !(error instanceof TypeError)) {
      console.error(`convert_spark: ${input.pathOrUrl}: ${error.message}`);
      process.exit(1);
    }
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
}
