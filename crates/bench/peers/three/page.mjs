// The side of draw.mjs that runs in the browser.

import * as THREE from 'three';
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { HDRLoader } from 'three/addons/loaders/HDRLoader.js';
import { KTX2Loader } from 'three/addons/loaders/KTX2Loader.js';
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';

// As in_cycles.py has it: what a white matte sphere has in the mean under the environment, irradiance of the sun, the light beside it.
const WHITE = 0.7;
const SUN = 2.6;
const EVEN = 0.06;

const scene = new THREE.Scene();
const sun = new THREE.DirectionalLight(0xffffff, SUN);
scene.add(sun, sun.target);
let renderer, loader, camera, target, sky, even;

/** The environment's light, by the mean luminance over the sphere of its directions. */
function strength({ data, width, height }) {
  let sum = 0;
  let weights = 0;
  for (let y = 0; y < height; y++) {
    const weight = Math.sin(((y + 0.5) / height) * Math.PI);
    for (let x = 0; x < width; x++) {
      const [r, g, b] = [0, 1, 2].map((k) => THREE.DataUtils.fromHalfFloat(data[4 * (y * width + x) + k]));
      sum += (weight * (0.2126 * r + 0.7152 * g + 0.0722 * b)) / width;
    }
    weights += weight;
  }
  return (WHITE * weights) / sum;
}

function filtered(picture) {
  picture.mapping = THREE.EquirectangularReflectionMapping;
  return new THREE.PMREMGenerator(renderer).fromEquirectangular(picture).texture;
}

async function begin({ environment, width, shift, fov }) {
  renderer = new THREE.WebGLRenderer({ antialias: false, alpha: true });
  renderer.setClearColor(0x000000, 0);
  target = new THREE.WebGLRenderTarget(width, width, { type: THREE.HalfFloatType });
  camera = new THREE.PerspectiveCamera(fov, 1, 1, 2);
  camera.setViewOffset(width, width, shift, shift, width, width);
  const textures = new KTX2Loader().setTranscoderPath('/1/examples/jsm/libs/basis/').detectSupport(renderer);
  const draco = new DRACOLoader().setDecoderPath('/1/examples/jsm/libs/draco/gltf/');
  loader = new GLTFLoader().setDRACOLoader(draco).setKTX2Loader(textures).setMeshoptDecoder(MeshoptDecoder);
  const picture = await new HDRLoader().loadAsync(environment);
  sky = { light: filtered(picture), strength: strength(picture.image) };
  const ones = new Uint16Array(4 * 64 * 32).fill(THREE.DataUtils.toHalfFloat(1));
  const constant = new THREE.DataTexture(ones, 64, 32, THREE.RGBAFormat, THREE.HalfFloatType);
  constant.needsUpdate = true;
  even = { light: filtered(constant), strength: EVEN };
}

async function load(url) {
  const asset = (await loader.loadAsync(url)).scene;
  const lights = [];
  asset.traverse((o) => o.isLight && lights.push(o));
  lights.forEach((light) => light.removeFromParent());
  scene.add(asset);
}

async function view({ eye, sun: towards, center, distance }) {
  const at = new THREE.Vector3(...center);
  [camera.near, camera.far] = [0.2 * distance, 3 * distance];
  camera.position.copy(at).addScaledVector(new THREE.Vector3(...eye), distance);
  camera.lookAt(at);
  camera.updateProjectionMatrix();
  sun.visible = towards !== null;
  sun.position.set(...(towards ?? [0, 1, 0]));
  const { light, strength } = towards ? even : sky;
  [scene.environment, scene.environmentIntensity] = [light, strength];
  renderer.setRenderTarget(target);
  renderer.clear();
  renderer.render(scene, camera);
  const { width } = target;
  const values = new Uint16Array(4 * width * width);
  renderer.readRenderTargetPixels(target, 0, 0, width, width, values);
  // Rows come from the bottom.
  const rows = Array.from({ length: width }, (_, y) => values.subarray(4 * width * (width - 1 - y), 4 * width * (width - y)));
  const taken = await fetch('/', { method: 'POST', body: new Blob(rows) });
  if (!taken.ok) throw new Error('a picture is not taken');
}

window.draw = { begin, load, view };
