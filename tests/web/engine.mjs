// SPDX-License-Identifier: GPL-3.0-or-later

// node engine.mjs FOLDER [PICTURE.png]...: what `maquette lod` has written, in a real browser
//   three.js loads the coarsest tile by GLTFLoader with DRACOLoader and MeshoptDecoder
//   3d-tiles-renderer loads tileset.json and tileset_implicit.json, and shows several levels at once
//   the picture is right: seen straight from above, no pixel of the background shines through the
//   terrain, whichever levels meet; and the terrain ends where the site ends
//   with --textures the coarsest level is shaded as the full surface is, closer than without: seen
//   from above under a low sun, the folders draco and textured
//   no message on the console
//   of folders of one compression all choose the same levels: what lies on a body at full size those
//   that the model does

import { existsSync, readFileSync } from 'node:fs';
import { join } from 'node:path';

import { browser, expect, finish, here, load, skip } from './packages.mjs';
import { serve } from './serving.mjs';

load('playwright-core');
if (!existsSync(join(here, 'node_modules/3d-tiles-renderer'))) skip('3d-tiles-renderer is not installed');

const page = `<!doctype html><meta charset="utf-8"><title>engine</title>
<link rel="icon" href="data:,">
<script type="importmap">{"imports": {
  "three": "/node_modules/three/build/three.module.js",
  "three/addons/": "/node_modules/three/examples/jsm/",
  "three/examples/jsm/": "/node_modules/three/examples/jsm/",
  "3d-tiles-renderer": "/node_modules/3d-tiles-renderer/build/index.js",
  "3d-tiles-renderer/core": "/node_modules/3d-tiles-renderer/build/index.core.js",
  "3d-tiles-renderer/three": "/node_modules/3d-tiles-renderer/build/index.three.js",
  "3d-tiles-renderer/plugins": "/node_modules/3d-tiles-renderer/build/index.plugins.js"
}}</script><body style="margin:0"></body>`;

const site = await serve(page);
const chromium = await browser();

/** Runs in the page. */
async function show({ tileset, size, scale, root }) {
  const THREE = await import('three');
  const { GLTFLoader } = await import('three/addons/loaders/GLTFLoader.js');
  const { DRACOLoader } = await import('three/addons/loaders/DRACOLoader.js');
  const { MeshoptDecoder } = await import('three/addons/libs/meshopt_decoder.module.js');
  const { TilesRenderer } = await import('3d-tiles-renderer');
  const { ImplicitTilingPlugin } = await import('3d-tiles-renderer/plugins');
  const manager = new THREE.LoadingManager();
  const draco = new DRACOLoader(manager).setDecoderPath('/node_modules/three/examples/jsm/libs/draco/gltf/');
  const gltf = new GLTFLoader(manager).setDRACOLoader(draco).setMeshoptDecoder(MeshoptDecoder);
  const one = await gltf.loadAsync(root);
  const box = new THREE.Box3().setFromObject(one.scene);

  const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
  renderer.setSize(800, 800);
  document.body.replaceChildren(renderer.domElement);
  renderer.setClearColor(0xff00ff);
  const scene = new THREE.Scene();
  const sun = new THREE.DirectionalLight(0xffffff, 5);
  sun.position.set(-1, 0.7, 0.5);
  scene.add(sun, new THREE.AmbientLight(0xffffff, 0.5));
  manager.addHandler(/\.(gltf|glb)$/, gltf);
  const tiles = new TilesRenderer(tileset);
  tiles.registerPlugin(new ImplicitTilingPlugin());
  tiles.manager.addHandler(/\.(gltf|glb)$/, gltf);
  const failed = [];
  tiles.addEventListener('load-error', (event) => failed.push(String(event.error ?? event.url)));
  // A tileset is z up, and may lie on a body.
  const { root: { transform } } = await (await fetch(tileset)).json();
  tiles.group.matrixAutoUpdate = false;
  tiles.group.matrix.makeRotationX(-Math.PI / 2);
  if (transform) tiles.group.matrix.multiply(new THREE.Matrix4().fromArray(transform).invert());
  scene.add(tiles.group);
  scene.updateMatrixWorld(true);
  // From above one corner of the site: near tiles are fine, far ones coarse.
  const [w, h] = size;
  const middle = box.getCenter(new THREE.Vector3());
  const chooser = new THREE.PerspectiveCamera(70, 1, 0.001 * scale, 100 * scale);
  chooser.position.set(0.1 * w, box.max.y + 0.15 * w, -0.1 * h);
  chooser.lookAt(0.45 * w, middle.y, -0.45 * h);
  chooser.updateMatrixWorld();
  tiles.errorTarget = 6;
  tiles.setCamera(chooser);
  tiles.setResolution(chooser, 800, 800);
  const levels = new Set();
  for (let quiet = 0, turn = 0; quiet < 10 && turn < 600; turn += 1) {
    tiles.update();
    quiet = tiles.stats.downloading + tiles.stats.parsing > 0 || tiles.visibleTiles.size === 0 ? 0 : quiet + 1;
    await new Promise((resolve) => { setTimeout(resolve, 20); });
  }
  let visible = 0;
  tiles.visibleTiles.forEach((tile) => {
    const uri = tile.content?.uri ?? '';
    const depth = /tiles\/(\d+)\//.exec(uri);
    if (depth) { levels.add(+depth[1]); visible += 1; }
  });
  // Frustum culling is the chooser's; what it does not see is not there. Look at what it sees.
  renderer.render(scene, chooser);
  const oblique = renderer.domElement.toDataURL();
  const instances = [];
  scene.traverse((o) => { if (o.isInstancedMesh) instances.push(o.count); });

  // All levels that were chosen, from straight above with the chooser far away: everything is there.
  const above = new THREE.OrthographicCamera(-0.55 * w, 0.55 * w, 0.55 * h, -0.55 * h, 0.001 * scale, 100 * scale);
  above.position.set(0.5 * w, box.max.y + scale, -0.5 * h);
  above.up.set(0, 0, -1);
  above.lookAt(0.5 * w, 0, -0.5 * h);
  above.updateMatrixWorld();
  const pictures = [oblique];
  const holes = [], shades = [];
  for (const target of [200, 4, 1e-9]) {
    tiles.deleteCamera(chooser);
    tiles.setCamera(above);
    tiles.setResolution(above, 800, 800);
    tiles.errorTarget = target;
    for (let quiet = 0, turn = 0; quiet < 10 && turn < 600; turn += 1) {
      tiles.update();
      quiet = tiles.stats.downloading + tiles.stats.parsing > 0 || tiles.visibleTiles.size === 0 ? 0 : quiet + 1;
      await new Promise((resolve) => { setTimeout(resolve, 20); });
    }
    renderer.render(scene, above);
    const gl = renderer.getContext();
    const pixels = new Uint8Array(4 * 800 * 800);
    gl.readPixels(0, 0, 800, 800, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let through = 0, outside = 0;
    for (let y = 0; y < 800; y += 1)
      for (let x = 0; x < 800; x += 1) {
        const i = 4 * (800 * y + x);
        const background = pixels[i] === 255 && pixels[i + 1] === 0 && pixels[i + 2] === 255;
        const u = (x + 0.5) / 800 * 1.1 - 0.05, v = (y + 0.5) / 800 * 1.1 - 0.05;
        const slack = 1.5 * 1.1 / 800;
        if (background && Math.min(u, 1 - u, v, 1 - v) > slack) through += 1;
        if (!background && Math.min(u, 1 - u, v, 1 - v) < -slack) outside += 1;
      }
    holes.push([target, through, outside, tiles.visibleTiles.size]);
    // Green of pieces of 4 x 4 pixels inside the site.
    const shade = [];
    for (let y = 40; y < 760; y += 4)
      for (let x = 40; x < 760; x += 4) {
        let sum = 0;
        for (let k = 0; k < 16; k += 1) sum += pixels[4 * (800 * (y + (k >> 2)) + x + (k & 3)) + 1];
        shade.push(sum / 16);
      }
    shades.push(shade);
    pictures.push(renderer.domElement.toDataURL());
  }
  return { failed, levels: [...levels], visible, holes, shades, pictures, instances,
    box: [box.min.toArray(), box.max.toArray()] };
}

const wanted = process.argv.slice(2);
let loaded = 0;
const choices = new Map(), shaded = new Map();
for (const folder of wanted.filter((p) => !p.endsWith('.png'))) {
  site.folder = folder;
  const lod = JSON.parse(readFileSync(join(folder, 'lod.json')));
  const scale = lod.metres_per_model_metre[0];
  const size = lod.nodes.map((n) => 1e-3 * scale * lod.spacing_mm * (n - 1));
  for (const name of ['tileset.json', 'tileset_implicit.json']) {
    const tab = await chromium.newPage({ viewport: { width: 800, height: 800 } });
    const said = [];
    tab.on('console', (m) => {
      // Reading the picture back is what the test does; of 3D Tiles 1.1 the renderer always warns.
      const known = ['ReadPixels', 'tiles versions at 1.1'].some((text) => m.text().includes(text));
      if (['error', 'warning'].includes(m.type()) && !known) said.push(m.text());
    });
    tab.on('pageerror', (e) => said.push(String(e)));
    await tab.goto(`${site.url}/`);
    const seen = await tab.evaluate(show, { tileset: `/data/${name}`, size, scale, root: '/data/tiles/0/0/0.glb' });
    const what = `${folder}/${name}`;
    loaded += 1;
    expect(said.length === 0, `${what}: the console says ${said.slice(0, 3)}`);
    expect(seen.failed.length === 0, `${what}: ${seen.failed.slice(0, 3)}`);
    expect(seen.visible > 0, `${what}: nothing is visible`);
    if (lod.levels.length > 2) expect(seen.levels.length > 1, `${what}: levels ${seen.levels} only`);
    shaded.set(folder, seen.shades);
    const [min, max] = seen.box;
    const near = (a, b) => Math.abs(a - b) < 1e-6 * scale;
    const choice = [name, lod.compression].join(), chosen = [seen.levels.sort(), seen.visible, seen.holes.map((h) => h[3])].join();
    if (!choices.has(choice)) choices.set(choice, chosen);
    expect(choices.get(choice) === chosen, `${what}: levels and tiles are ${chosen}, of another set of the same surface ${choices.get(choice)}`);
    expect(near(min[0], 0) && near(max[0], size[0]) && near(max[2], 0) && near(min[2], -size[1]),
      `${what}: the coarsest tile covers ${seen.box}`);
    for (const [target, through, outside, tiles] of seen.holes) {
      expect(tiles > 0, `${what}: no tile at error target ${target}`);
      expect(through === 0, `${what}: ${through} pixels of background at error target ${target}`);
      expect(outside === 0, `${what}: ${outside} pixels beside the site at error target ${target}`);
    }
    const picture = wanted.find((p) => p.endsWith('.png'));
    if (picture) {
      const { writeFileSync } = await import('node:fs');
      seen.pictures.forEach((data, i) =>
        writeFileSync(picture.replace('.png', `_${loaded}_${i}.png`), Buffer.from(data.split(',')[1], 'base64')));
    }
    console.log(`${what}: levels ${seen.levels.sort().join(' ')}, ${seen.visible} tiles; instances ${seen.instances}`);
    await tab.close();
  }
}
await chromium.close();
site.close();
if (shaded.has('draco') && shaded.has('textured')) {
  const apart = (a, b) => Math.sqrt(a.reduce((sum, v, i) => sum + (v - b[i]) ** 2, 0) / a.length);
  const full = shaded.get('draco').at(-1), without = apart(shaded.get('draco')[0], full),
    pictured = apart(shaded.get('textured')[0], full);
  console.log(`coarsest level and full surface, of 255: ${without.toFixed(1)} apart, with pictures ${pictured.toFixed(1)}`);
  expect(pictured < 0.8 * without, `shading is ${pictured} apart with pictures, ${without} without`);
}
finish(`${loaded} tilesets`);
