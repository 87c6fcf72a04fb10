// Writes a glTF file without meshopt compression: `node plain.mjs PROGRAM IN OUT`, PROGRAM that of gltf-transform, whose modules
// are used.

import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';

const [program, from, to] = process.argv.slice(2);
const require = createRequire(pathToFileURL(program));
const load = (name) => import(pathToFileURL(require.resolve(name)).href);
const { NodeIO } = await load('@gltf-transform/core');
const { ALL_EXTENSIONS } = await load('@gltf-transform/extensions');
const { dequantize } = await load('@gltf-transform/functions');
const { MeshoptDecoder } = await load('meshoptimizer');

await MeshoptDecoder.ready;
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({ 'meshopt.decoder': MeshoptDecoder });
const asset = await io.read(from);
for (const extension of asset.getRoot().listExtensionsUsed()) {
  if (extension.extensionName === 'EXT_meshopt_compression') extension.dispose();
}
await asset.transform(dequantize());
await io.write(to, asset);
