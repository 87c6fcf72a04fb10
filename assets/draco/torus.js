// Writes torus.glb: a torus of 40 x 16 quads with a seam, a hole and two cuts, with every attribute that photofit reads. The
// files beside this script were made from it by gltf-transform 4.5.1, whose encoder is Google's:
//   node torus.js
//   gltf-transform draco torus.glb torus-valence.glb --encode-speed 0 --decode-speed 0
//   gltf-transform draco torus.glb torus-standard.glb --encode-speed 7 --decode-speed 7
//   gltf-transform draco torus.glb torus-sequential.glb --method sequential
const around = 40, tube = 16;
const values = {POSITION: [], NORMAL: [], TANGENT: [], TEXCOORD_0: [], TEXCOORD_1: [], COLOR_0: [], JOINTS_0: [], WEIGHTS_0: []};
for (let i = 0; i <= around; i++) for (let j = 0; j <= tube; j++) {
  const a = 2 * Math.PI * (i % around) / around, b = 2 * Math.PI * (j % tube) / tube, r = 1 + 0.4 * Math.cos(b);
  values.POSITION.push(r * Math.cos(a), 0.4 * Math.sin(b), r * Math.sin(a));
  values.NORMAL.push(Math.cos(b) * Math.cos(a), Math.sin(b), Math.cos(b) * Math.sin(a));
  values.TANGENT.push(-Math.sin(a), 0, Math.cos(a), i < around / 2 ? 1 : -1);
  values.TEXCOORD_0.push(i / around, j / tube);
  values.TEXCOORD_1.push(j * 4095, (around - i) * 1638);
  values.COLOR_0.push(i * 6, j * 15, (i * 7 + j * 3) % 256, 255);
  values.JOINTS_0.push(i < around / 2 ? 0 : 1, 1, 0, 0);
  values.WEIGHTS_0.push(1 - j / tube, j / tube, 0, 0);
}
const indices = [];
for (let i = 0; i < around; i++) for (let j = 0; j < tube; j++) {
  if (i >= 5 && i < 9 && j >= 3 && j < 7 || i == 20 || i == 30) continue;
  const p = i * (tube + 1) + j, q = p + tube + 1;
  indices.push(p, p + 1, q, q, p + 1, q + 1);
}
const parts = [], bufferViews = [], accessors = [];
let bytes = 0;
function accessor(data, componentType, width, more) {
  const part = Buffer.from(data.buffer), padding = Buffer.alloc((4 - part.length % 4) % 4);
  bufferViews.push({buffer: 0, byteOffset: bytes, byteLength: part.length});
  bytes += part.length + padding.length;
  parts.push(part, padding);
  const type = {1: 'SCALAR', 2: 'VEC2', 3: 'VEC3', 4: 'VEC4', 16: 'MAT4'}[width];
  accessors.push({bufferView: bufferViews.length - 1, componentType, count: data.length / width, type, ...more});
  return accessors.length - 1;
}
const floats = (v, width, more) => accessor(new Float32Array(v), 5126, width, more);
const attributes = {
  POSITION: floats(values.POSITION, 3, {min: [-1.4, -0.4, -1.4].map(Math.fround), max: [1.4, 0.4, 1.4].map(Math.fround)}),
  NORMAL: floats(values.NORMAL, 3),
  TANGENT: floats(values.TANGENT, 4),
  TEXCOORD_0: floats(values.TEXCOORD_0, 2),
  TEXCOORD_1: accessor(new Uint16Array(values.TEXCOORD_1), 5123, 2, {normalized: true}),
  COLOR_0: accessor(new Uint8Array(values.COLOR_0), 5121, 4, {normalized: true}),
  JOINTS_0: accessor(new Uint16Array(values.JOINTS_0), 5123, 4),
  WEIGHTS_0: floats(values.WEIGHTS_0, 4),
};
const triangles = accessor(new Uint16Array(indices), 5123, 1);
const identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const inverseBindMatrices = floats([...identity, ...identity], 16);
const json = JSON.stringify({
  asset: {version: '2.0'}, scene: 0, scenes: [{nodes: [0, 1]}],
  nodes: [{mesh: 0, skin: 0}, {children: [2]}, {}], skins: [{joints: [1, 2], inverseBindMatrices}],
  meshes: [{primitives: [{attributes, indices: triangles, material: 0}]}], materials: [{}],
  accessors, bufferViews, buffers: [{byteLength: bytes}],
});
const text = Buffer.from(json + ' '.repeat((4 - json.length % 4) % 4)), binary = Buffer.concat(parts);
const words = (...w) => Buffer.from(new Uint32Array(w).buffer);
require('fs').writeFileSync('torus.glb', Buffer.concat([
  words(0x46546c67, 2, 28 + text.length + binary.length),
  words(text.length, 0x4e4f534a), text, words(binary.length, 0x004e4942), binary]));
