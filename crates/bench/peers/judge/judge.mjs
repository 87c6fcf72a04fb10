// Judges glTF files by the validator and the asset auditor of Khronos: `node judge.mjs FILE...`.
// Status 1 where the validator has errors or warnings, or a file cannot be read; what the auditor fails is listed.

import { readFile } from 'node:fs/promises';
import path from 'node:path';
import { Auditor } from '@khronosgroup/gltf-asset-auditor';
import validator from 'gltf-validator';

// The recommendations of the Khronos 3D Commerce asset creation guidelines.
const GUIDELINES = {
  version: '1.0.5',
  fileSizeInKb: { maximum: 5120 },
  materials: { maximum: 5 },
  model: {
    objectCount: { nodes: { maximum: 5 }, meshes: { maximum: 5 }, primitives: { maximum: 5 } },
    requireCleanRootNodeTransform: true,
    triangles: { maximum: 100000 },
  },
  product: {
    dimensions: {
      height: { maximum: 100, minimum: 0.01 },
      length: { maximum: 100, minimum: 0.01 },
      width: { maximum: 100, minimum: 0.01 },
    },
  },
  textures: {
    height: { maximum: 2048, minimum: 512 },
    width: { maximum: 2048, minimum: 512 },
    pbrColorRange: { maximum: 240, minimum: 30 },
    requireDimensionsBePowersOfTwo: true,
  },
  uvs: {
    pixelsPerMeter: { maximum: 100000 },
    requireNotInverted: true,
    requireNotOverlapping: true,
    requireRangeZeroToOne: true,
  },
};

async function validated(file) {
  const folder = path.dirname(file);
  const report = await validator.validateBytes(new Uint8Array(await readFile(file)), {
    uri: path.basename(file),
    maxIssues: 0,
    externalResourceFunction: async (uri) => new Uint8Array(await readFile(path.join(folder, decodeURIComponent(uri)))),
  });
  const { numErrors: errors, numWarnings: warnings, numInfos: infos, numHints: hints, messages, truncated } = report.issues;
  console.log(`  validator: ${errors} errors, ${warnings} warnings, ${infos} infos, ${hints} hints`);
  for (const m of messages.filter((m) => m.severity < 2).slice(0, 20)) console.log(`    ${m.code} at ${m.pointer}: ${m.message}`);
  return errors + warnings === 0 && !truncated;
}

async function audited(file) {
  if (!file.endsWith('.glb')) return console.log('  auditor: reads .glb files alone');
  const auditor = new Auditor();
  auditor.decimalDisplayPrecision = 2;
  auditor.schema.loadFromSchemaObject(GUIDELINES);
  await auditor.model.loadFromFileSystem([file]);
  auditor.generateReport();
  const tested = auditor.report.getItems().filter((item) => item.tested);
  console.log(`  auditor: ${tested.filter((item) => item.pass).length} of ${tested.length} checks pass`);
  for (const item of tested.filter((item) => !item.pass)) console.log(`    ${item.name}: ${item.message}`);
}

let clean = true;
for (const file of process.argv.slice(2)) {
  console.log(file);
  try {
    clean = (await validated(file)) && clean;
  } catch (error) {
    console.log(`  cannot be validated: ${error.message ?? error}`);
    clean = false;
    continue;
  }
  try {
    await audited(file);
  } catch (error) {
    console.log(`  auditor: cannot read it: ${error.message ?? error}`);
  }
}
process.exit(clean ? 0 : 1);
