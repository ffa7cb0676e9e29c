// SPDX-License-Identifier: GPL-3.0-or-later

// node cesium.mjs FOLDER [PICTURE.png]...: what `maquette lod` has written, in CesiumJS in a real
// browser, without ion, imagery, globe or network. Of tileset.json and tileset_implicit.json, on the
// Moon where the set is there at full size, else as a model that stands somewhere on the Earth:
//   all tiles load, none fails, no message on the console; near ground is finer than far ground
//   heights: where pixels' depth says that the surface is, it is: the finest level, decoded by the
//            formats' own decoders, as far away as the shown level's measured error allows, and what
//            a rasterizer does (below); places on a body are reckoned here once more
//   stones:  stand above the ground where stones.json has them
//   choice:  of the implicit tileset the tiles that the explicit one shows: boxes and errors are read
//            from the subtrees' tables
//   picture: from straight above no background shines through, the terrain ends where the site ends,
//            and is as bright as its slopes are under the lamp, with --textures on the coarsest level, too

import { existsSync, readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';

import { readGlb, turned, unpack } from './glb.mjs';
import { browser, expect, finish, here, load, skip } from './packages.mjs';
import { serve } from './serving.mjs';

load('playwright-core');
if (!existsSync(join(here, 'node_modules/cesium/Build/Cesium/Cesium.js'))) skip('cesium is not installed');

const kPlace = { lat: -43.3, lon: -11.2 }; // degrees, of `run`
const kMoon = 1737400; // metres, radius of the IAU's sphere
const kPixels = 600, kWider = 1.1; // of the picture from above: pixels, sites
const kSun = [-0.8, 0.4, 0.45]; // to the lamp: east, north, up

const site = await serve(`<!doctype html><meta charset="utf-8"><title>cesium</title>
<link rel="icon" href="data:,"><link rel="stylesheet" href="/node_modules/cesium/Build/Cesium/Widgets/CesiumWidget/CesiumWidget.css"><body style="margin:0"><div id="view" style="width:${kPixels}px;height:${kPixels}px"></div>
<script>window.CESIUM_BASE_URL = '/node_modules/cesium/Build/Cesium/';</script>
<script src="/node_modules/cesium/Build/Cesium/Cesium.js"></script></body>`);

/** Heights of the finest level at the field's nodes, metres of the content, rows from the south. */
async function surface(folder, lod) {
  const [cols, rows] = lod.nodes, k = lod.steps_per_quad;
  const [wide, high] = lod.metres_per_model_metre.map((m) => 1e-3 * m * lod.step_mm), steps = [wide, high, wide];
  const heights = new Float64Array(rows * cols).fill(NaN);
  const finest = join(folder, 'tiles', String(lod.levels[0].depth));
  for (const name of readdirSync(finest, { recursive: true }).filter((n) => n.endsWith('.glb'))) {
    const glb = readGlb(new Uint8Array(readFileSync(join(finest, name))));
    const [node] = glb.json.nodes, { attributes } = await unpack(glb);
    const p = turned(node, attributes.POSITION);
    const origin = node.translation.map((t, i) => Math.round(t / steps[i]));
    for (let i = 0; i < p.length; i += 3)
      heights[-(p[i + 2] + origin[2]) / k * cols + (p[i] + origin[0]) / k] = high * (p[i + 1] + origin[1]);
  }
  expect(heights.every(Number.isFinite), `${folder}: the finest level has no height at some node`);
  const quad = wide * k;
  /** Height, and slopes to the east and north; cells are cut from lower left to upper right. */
  return (x, y) => {
    const c = Math.min(Math.max(Math.floor(x / quad), 0), cols - 2), r = Math.min(Math.max(Math.floor(y / quad), 0), rows - 2);
    const u = x / quad - c, v = y / quad - r, at = r * cols + c;
    const [sw, se, nw, ne] = [heights[at], heights[at + 1], heights[at + cols], heights[at + cols + 1]];
    const [east, north] = u >= v ? [se - sw, ne - se] : [ne - nw, nw - sw];
    return { z: sw + u * east + v * north, slope: [east / quad, north / quad] };
  };
}

/** To the fixed frame from the tileset's: column-major, the site's middle on a sphere (closed form). */
function onTheMoon([w, h]) {
  const lat = kPlace.lat * Math.PI / 180, lon = kPlace.lon * Math.PI / 180;
  const east = [-Math.sin(lon), Math.cos(lon), 0];
  const north = [-Math.sin(lat) * Math.cos(lon), -Math.sin(lat) * Math.sin(lon), Math.cos(lat)];
  const up = [Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat)];
  const origin = up.map((u, i) => kMoon * u - 0.5 * w * east[i] - 0.5 * h * north[i]);
  return [...east, 0, ...north, 0, ...up, 0, ...origin, 1];
}

/** Runs in the page. `fixed`: to the fixed frame from the tileset's, null: the model stands on the Earth. */
async function show({ url, size, highest, fixed, sun, wider, stones }) {
  const C = window.Cesium;
  C.Ion.defaultAccessToken = '';
  if (fixed) C.Ellipsoid.default = C.Ellipsoid.MOON;
  const widget = new C.CesiumWidget('view', {
    baseLayer: false, globe: false, skyBox: false, skyAtmosphere: false, useDefaultRenderLoop: false, msaaSamples: 1,
    contextOptions: { webgl: { preserveDrawingBuffer: true, antialias: false } },
  });
  const { scene, camera } = widget;
  scene.backgroundColor = C.Color.MAGENTA;
  const frame = fixed ? C.Matrix4.fromArray(fixed) : C.Transforms.eastNorthUpToFixedFrame(C.Cartesian3.fromDegrees(8, 47, 400));
  const tileset = await C.Cesium3DTileset.fromUrl(url, fixed ? {} : { modelMatrix: frame });
  scene.primitives.add(tileset);
  // One lamp, and no light from elsewhere.
  const world = (v) => C.Matrix4.multiplyByPointAsVector(frame, C.Cartesian3.fromArray(v), new C.Cartesian3());
  tileset.imageBasedLighting.imageBasedLightingFactor = C.Cartesian2.ZERO;
  scene.light = new C.DirectionalLight({ direction: C.Cartesian3.negate(world(sun), new C.Cartesian3()), intensity: 3 });

  const failed = [];
  let visible = new Set(), settled = 0;
  tileset.tileFailed.addEventListener(({ url: u, message }) => failed.push(`${u}: ${message}`));
  tileset.tileVisible.addEventListener((tile) => visible.add(tile.content.url));
  tileset.allTilesLoaded.addEventListener(() => { settled += 1; });
  /** Looks along `direction` from `eye`, in the tileset's frame, until all that is wanted is there. */
  async function look(eye, direction, up, frustum, error) {
    camera.frustum = frustum;
    camera.position = C.Matrix4.multiplyByPoint(frame, C.Cartesian3.fromArray(eye), new C.Cartesian3());
    camera.direction = C.Cartesian3.normalize(world(direction), new C.Cartesian3());
    camera.right = C.Cartesian3.normalize(C.Cartesian3.cross(camera.direction, world(up), new C.Cartesian3()), new C.Cartesian3());
    camera.up = C.Cartesian3.cross(camera.right, camera.direction, new C.Cartesian3());
    tileset.maximumScreenSpaceError = error;
    let turn = 0;
    for (let quiet = 0; quiet < 10 && turn < 1500; turn += 1) {
      visible = new Set();
      widget.render();
      quiet = tileset.tilesLoaded && visible.size > 0 ? quiet + 1 : 0;
      await new Promise((resolve) => { setTimeout(resolve, 10); });
    }
    return { loaded: tileset.tilesLoaded, tiles: [...visible], picture: scene.canvas.toDataURL() };
  }
  /** Where the surface is in the tileset's frame, by the depth at the middles of pixels. */
  function picked(pixels) {
    const back = C.Matrix4.inverseTransformation(frame, new C.Matrix4());
    return pixels.map(([x, y]) => scene.pickPosition(new C.Cartesian2(Math.floor(x) + 0.5, Math.floor(y) + 0.5)))
      .filter(Boolean).map((at) => C.Cartesian3.pack(C.Matrix4.multiplyByPoint(back, at, new C.Cartesian3()), []));
  }
  const side = scene.canvas.clientWidth, grid = [];
  for (let y = 10; y < side; y += 20) for (let x = 10; x < side; x += 20) grid.push([x, y]);

  const [w, h] = size, gl = scene.canvas.getContext('webgl2');
  const views = [];
  // Over one corner, to the other one: near ground is fine, far ground coarse.
  const eye = [0.1 * w, 0.1 * h, highest + 0.15 * w], target = [0.45 * w, 0.45 * h, highest];
  views.push(await look(eye, target.map((t, i) => t - eye[i]), [0, 0, 1],
    new C.PerspectiveFrustum({ fov: 70 * Math.PI / 180, aspectRatio: 1, near: 1e-3 * w, far: 100 * w }), 6));
  views[0].places = picked(grid);
  // From straight above: coarsest level, some, the finest.
  for (const error of [200, 4, 1e-9]) {
    const view = await look([0.5 * w, 0.5 * h, highest + w], [0, 0, -1], [0, 1, 0],
      new C.OrthographicFrustum({ width: wider * w, aspectRatio: 1, near: 1e-3 * w, far: 100 * w }), error);
    view.places = picked([...grid, ...stones.map(([x, y]) => [(x / w - 0.5) / wider + 0.5, 0.5 - (y - 0.5 * h) / w / wider].map((t) => t * side))]);
    widget.render();
    const pixels = new Uint8Array(4 * side * side);
    gl.readPixels(0, 0, side, side, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    view.through = view.outside = 0;
    view.blocks = []; // east, north, brightness of 4 x 4 pixels
    for (let y = 0; y < side; y += 1)
      for (let x = 0; x < side; x += 1) {
        const at = (i, k) => [((i / side - 0.5) * wider + 0.5) * w, (k / side - 0.5) * wider * w + 0.5 * h];
        const [east, north] = at(x + 0.5, y + 0.5), i = 4 * (side * y + x);
        const inside = Math.min(east, w - east, north, h - north), slack = 1.5 * wider * w / side;
        const background = pixels[i] === 255 && pixels[i + 1] === 0 && pixels[i + 2] === 255;
        if (background && inside > slack) view.through += 1;
        if (!background && inside < -slack) view.outside += 1;
        if (x % 4 !== 0 || y % 4 !== 0 || inside < 0.02 * w) continue;
        let sum = 0;
        for (let k = 0; k < 16; k += 1) sum += (pixels[4 * (side * (y + (k >> 2)) + x + (k & 3)) + 1] / 255) ** 2.2;
        view.blocks.push([...at(x + 2, y + 2), sum / 16]);
      }
       views.push(view);
  }
  return { failed, settled, views, subpixels: 2 ** gl.getParameter(gl.SUBPIXEL_BITS) };
}

function correlation(a, b) {
  const mean = (v) => v.reduce((sum, x) => sum + x, 0) / v.length;
  const [ma, mb] = [mean(a), mean(b)];
  const product = (p, q) => p.reduce((sum, x, i) => sum + x * q[i], 0);
  const [da, db] = [a.map((x) => x - ma), b.map((x) => x - mb)];
  return product(da, db) / Math.sqrt(product(da, da) * product(db, db));
}

const chosen = new Map();
const wanted = process.argv.slice(2), picture = wanted.find((p) => p.endsWith('.png'));
const chromium = await browser();
let loaded = 0;
for (const folder of wanted.filter((p) => !p.endsWith('.png'))) {
  site.folder = folder;
  const lod = JSON.parse(readFileSync(join(folder, 'lod.json')));
  const [horizontal, vertical] = lod.metres_per_model_metre, [w, h] = lod.nodes.map((n) => 1e-3 * horizontal * lod.spacing_mm * (n - 1));
  const ground = await surface(folder, lod);
  const onBody = 'transform' in JSON.parse(readFileSync(join(folder, 'tileset.json'))).root;
  let highest = -Infinity, steepest = 0;
  for (let y = 0.5; y < lod.nodes[1]; y += 0.5)
    for (let x = 0.25; x < lod.nodes[0]; x += 0.5) {
      const { z, slope } = ground(x * w / lod.nodes[0], y * h / lod.nodes[1]);
      highest = Math.max(highest, z);
      steepest = Math.max(steepest, Math.hypot(...slope));
    }
  const stones = existsSync(join(folder, 'stones.json')) ? JSON.parse(readFileSync(join(folder, 'stones.json'))).stones : [];
  // No part of a stone is farther from its middle than twice its scale.
  const around = stones.map(({ translation_mm: [x, y], scale_mm }) => [x - lod.x0_mm, y - lod.y0_mm, 2 * scale_mm].map((v) => 1e-3 * horizontal * v));
  const stoneAt = ([x, y]) => around.findIndex(([sx, sy, r]) => Math.hypot(x - sx, y - sy) < r);
  for (const name of ['tileset.json', 'tileset_implicit.json']) {
    const what = `${folder}/${name}`, said = [];
    const tab = await chromium.newPage({ viewport: { width: kPixels, height: kPixels } });
    tab.on('console', (m) => {
      // Reading the picture back is what the test does.
      if (['error', 'warning'].includes(m.type()) && !m.text().includes('ReadPixels')) said.push(m.text());
    });
    tab.on('pageerror', (e) => said.push(String(e)));
    tab.on('request', (q) => expect(/^(data:|blob:)/.test(q.url()) || q.url().startsWith(`${site.url}/`), `${what}: ${q.url()} is asked`));
    await tab.goto(`${site.url}/`);
    const seen = await tab.evaluate(show, { url: `/data/${name}`, size: [w, h], highest, sun: kSun, wider: kWider, stones: around,
      fixed: onBody ? onTheMoon([w, h]) : null });
    loaded += 1;
    expect(said.length === 0, `${what}: the console says ${said.slice(0, 3)}`);
    expect(seen.failed.length === 0, `${what}: ${seen.failed.slice(0, 3)}`);
    expect(seen.settled > 0, `${what}: allTilesLoaded was never said`);
    const figures = [];
    seen.views.forEach((view, v) => {
      const key = `${folder}, view ${v}`, tiles = view.tiles.map((u) => new URL(u, site.url).pathname).sort().join();
      if (!chosen.has(key)) chosen.set(key, tiles);
      expect(chosen.get(key) === tiles, `${what}, view ${v}: ${view.tiles.length} tiles are shown, not those of the explicit tileset`);
      const depths = [...new Set(view.tiles.map((u) => /tiles\/(\d+)\//.exec(u)).filter(Boolean).map((d) => +d[1]))].sort();
      expect(view.loaded, `${what}, view ${v}: not all tiles are loaded`);
      expect(depths.length > 0, `${what}, view ${v}: no tile is visible`);
      if (v === 0) expect(depths.length > 1, `${what}: near and far ground have depth ${depths}`);
      if (v === 1) expect(String(depths) === '0', `${what}: depth ${depths}, the coarsest is 0`);
      if (v === 3) expect(String(depths) === String(lod.levels[0].depth), `${what}: depth ${depths}, the finest is ${lod.levels[0].depth}`);
      expect(stones.length === 0 || view.tiles.some((u) => u.includes('/stones/')), `${what}, view ${v}: no stones`);
      // What may lie between: the error of the coarsest level that is shown, which for the finest is
      // its rounding; a vertex is moved to the next of `subpixels` places across a pixel (of the far
      // ground in perspective, at most as wide as the site there); 24 bits of depth over twice the
      // eye's distance, and as much again for floats of the eye's frame.
      const worst = Math.max(...lod.levels.filter((l) => depths.includes(l.depth)).map((l) => l.max_vertical_error_mm));
      const pixel = v === 0 ? 2 * w / kPixels : kWider * w / kPixels;
      const allowed = 1e-3 * vertical * worst + steepest * pixel / seen.subpixels + 4 * w * 2 ** -23;
      let farthest = 0, on = 0;
      const above = new Set();
      for (const at of view.places) {
        const stone = stoneAt(at), off = at[2] - ground(at[0], at[1]).z;
        if (stone >= 0) { if (off > allowed) above.add(stone); continue; }
        on += 1;
        farthest = Math.max(farthest, Math.abs(off));
      }
      expect(on > 300, `${what}, view ${v}: the ground is seen in ${on} places`);
      expect(farthest <= allowed, `${what}, view ${v}: a picked place is ${farthest} m off the surface, ${allowed} allowed`);
      figures.push(`${(1e3 * farthest / vertical).toFixed(4)} of ${(1e3 * allowed / vertical).toFixed(4)} (depth ${depths.join(' ')})`);
      if (v === 0) return;
      if (v === 3) expect(above.size === stones.length, `${what}: ${above.size} of ${stones.length} stones stand above the ground`);
      expect(view.through === 0, `${what}, view ${v}: ${view.through} pixels of background`);
      expect(view.outside === 0, `${what}, view ${v}: ${view.outside} pixels beside the site`);
      const blocks = view.blocks.filter((block) => stoneAt(block) < 0);
      const lambert = ([x, y]) => {
        const { slope } = ground(x, y);
        return Math.max(0, (kSun[2] - slope[0] * kSun[0] - slope[1] * kSun[1]) / Math.hypot(1, ...slope));
      };
      const alike = correlation(blocks.map((block) => block[2]), blocks.map(lambert));
      // One lamp, no other light: what is left is smooth against flat shading and bits of normals.
      // Of the surface's own detail the coarsest triangles show a part only, pictures show it.
      if (v === 3 || (v === 1 && lod.texels > 0)) expect(alike > 0.8, `${what}, view ${v}: brightness and slopes correlate by ${alike}`);
      figures.push(`shading ${alike.toFixed(3)}`);
    });
    if (picture)
      seen.views.forEach((view, v) => writeFileSync(picture.replace('.png', `_${loaded}_${v}.png`), Buffer.from(view.picture.split(',')[1], 'base64')));
    console.log(`${what}: off the surface, mm of the model: ${figures.join(', ')}`);
    await tab.close();
  }
}
await chromium.close();
site.close();
finish(`${loaded} tilesets in CesiumJS`);
