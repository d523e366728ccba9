// Validates glTF files with the Khronos validator (npm package `gltf-validator`).
//
//   node tests/validate_gltf.mjs FILE.glb ...
//
// The package is looked for in $ISOLUME_GLTF_VALIDATOR (its own folder), then in
// target/npm/node_modules beside this repository's root. Prints one line a file, and each message
// of severity error or warning. Exit code 0: no error and no warning in any file; 1: some;
// 2: the validator or a file could not be read.

import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { basename, dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const root = dirname(dirname(fileURLToPath(import.meta.url)));
const folder = resolve(process.env.ISOLUME_GLTF_VALIDATOR || join(root, "target/npm/node_modules/gltf-validator"));
const files = process.argv.slice(2);

let validator;
try {
  validator = createRequire(import.meta.url)(folder);
} catch (error) {
  console.error(`no gltf-validator in ${folder}: ${error.message}`);
  console.error("install it: npm install --prefix target/npm --no-save gltf-validator");
  process.exit(2);
}
if (files.length === 0) {
  console.error("name at least one .glb or .gltf file");
  process.exit(2);
}

const severities = ["error", "warning", "info", "hint"];
let bad = 0;
for (const file of files) {
  let bytes;
  try {
    bytes = new Uint8Array(await readFile(file));
  } catch (error) {
    console.error(`${file}: ${error.message}`);
    process.exit(2);
  }
  const report = await validator.validateBytes(bytes, { uri: basename(file), maxIssues: 100 });
  const { numErrors, numWarnings, numInfos, numHints, messages } = report.issues;
  if (numErrors + numWarnings > 0) bad += 1;
  console.log(
    `${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos, ${numHints} hints; ` +
      `${report.info?.totalVertexCount ?? 0} vertices, ${report.info?.totalTriangleCount ?? 0} triangles`,
  );
  for (const { severity, code, message, pointer } of messages) {
    if (severity <= 1 || process.env.VERBOSE) console.log(`  ${severities[severity]} ${code} at ${pointer}: ${message}`);
  }
}
console.log(`${files.length - bad} of ${files.length} files without errors and warnings (gltf-validator ${validator.version()})`);
process.exit(bad > 0 ? 1 : 0);
