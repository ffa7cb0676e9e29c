// SPDX-License-Identifier: GPL-3.0-or-later

// node view.mjs MAQUETTE LOD RUN [FOLDER]: the page of `maquette view` in a real browser, over a
// folder of `maquette lod` and one of `maquette run` of the same design; pictures go to FOLDER
//   loads; nothing on the console, nothing asked of another host
//   a click gives the place and the height       the file's height there, within the stated error
//   sun and exaggeration change the picture; dark and light; each control has a name
//   stones, profile, link (the same picture), screenshot, keyboard
//   a run's folder: deviation colours, brush (typed, and dragged over the histogram), toolpath, both surfaces, camera frame
//   photographs of a case and poses of a trajectory: clicked, stepped through, looked from
//   residuals of a diagnosis, before and after: one scale, side by side, without a surface too
//   a damaged, a missing and a damaged coarsest tile are said and the rest works; no WebGL 2 is said

import { cpSync, readFileSync, rmSync, truncateSync } from 'node:fs';
import { join } from 'node:path';
import { look } from './looking.mjs';
import { expect, finish } from './packages.mjs';

const [maquette, lodFolder, runFolder, pictures] = process.argv.slice(2);
const { serve, tab, still, ask, differ, shot, whole, slide, go, nameless, close } = await look(maquette, pictures);

const lodUrl = await serve(lodFolder), runUrl = await serve(runFolder);
/** The design itself, by GDAL; view_server_test holds this against a closed form. */
const design = async (from, to, count) =>
  (await (await fetch(`${runUrl}profile?file=s1000/design.tif&from=${from}&to=${to}&count=${count}`)).json()).values;
const lod = JSON.parse(readFileSync(join(lodFolder, 'lod.json')));
const stones = JSON.parse(readFileSync(join(lodFolder, 'stones.json'))).stones;
const size = lod.spacing_mm * (lod.nodes[0] - 1);
// The tile's own error, what three decimals of z leave, and of x and y on a slope of one.
const kHeight = lod.levels[0].max_vertical_error_mm + 0.0005 + 2 * 0.0005;

// Levels of detail.
{
  const page = await tab(lodUrl);
  await still(page);
  console.log(`first picture after ${await page.evaluate(() => document.documentElement.dataset.firstPicture)} ms`);
  await whole(page, 'lod');
  await page.click('#above');
  const light = await shot(page, 'above');
  const box = await page.locator('#canvas').boundingBox();
  const [cx, cy] = [Math.round(box.width / 2), Math.round(box.height / 2)];
  const middle = (await ask(page, cx, cy)).place;
  // The middle of the site is in the middle of the picture; a pixel is a tenth of a mm here.
  expect(Math.abs(middle[0] - size / 2) < 0.2 && Math.abs(middle[1] - size / 2) < 0.2, `the middle is at ${middle}`);
  for (const [dx, dy] of [[0, 0], [120, 40], [-90, 110], [60, -150], [-140, -60]]) {
    const { text, place } = await ask(page, cx + dx + 1, cy + dy + 1);
    if (text.includes('on a stone')) continue;
    const [z] = await design(place.slice(0, 2), place.slice(0, 2), 1);
    expect(Math.abs(place[2] - z) < kHeight, `${text}: the design is ${z} there`);
    expect(Math.sign(place[0] - middle[0]) === Math.sign(dx + 1) && Math.sign(place[1] - middle[1]) === -Math.sign(dy + 1),
      `${dx}, ${dy} pixels from the middle is ${place}`);
  }
  await slide(page, '#azimuth', 135);
  const turned = await shot(page, 'sun');
  expect(await differ(page, light, turned) > 0.1, 'the sun from the other side changes nothing');
  await slide(page, '#azimuth', 315);
  const back = await shot(page, 'sun_back');
  expect(await differ(page, light, back) < 0.01, 'the same sun is another picture');
  await page.click('#oblique');
  const flat = await shot(page, 'oblique');
  await slide(page, '#exaggeration', 3);
  expect(await differ(page, flat, await shot(page, 'exaggerated')) > 0.05, 'exaggeration changes nothing');
  const high = (await ask(page, cx, cy)).place, [zHigh] = await design(high.slice(0, 2), high.slice(0, 2), 1);
  expect(Math.abs(high[2] - zHigh) < kHeight, `exaggerated: ${high}, the design is ${zHigh}`);
  await slide(page, '#exaggeration', 1);

  const s = stones[2];
  await page.selectOption('#stone', String(s.number));
  const data = await page.locator('#stone-data').innerText();
  expect(data.includes(`${s.scale_mm.toFixed(3)} mm`), `stone ${s.number}: ${data}`);
  await still(page);
  const onStone = await ask(page, cx, cy);
  expect(onStone.text.includes(`on a stone; stone ${s.number}`), `a click on stone ${s.number} says ${onStone.text}`);
  await whole(page, 'stone');

  await page.click('#above');
  await still(page);
  await page.click('#profile-mode');
  const from = await ask(page, cx - 100, cy - 50), to = await ask(page, cx + 120, cy + 70);
  await page.waitForFunction(() => document.querySelector('#profile-text').textContent.startsWith('From'));
  const told = /heights (-?[\d.]+) to (-?[\d.]+) mm/.exec(await page.locator('#profile-text').textContent());
  const line = await design(from.place.slice(0, 2), to.place.slice(0, 2), 500);
  // Five digits of heights of up to 100 mm.
  expect(told && Math.abs(told[1] - Math.min(...line)) < kHeight + 0.0005 && Math.abs(told[2] - Math.max(...line)) < kHeight + 0.0005,
    `the profile says ${told}, the design ${Math.min(...line)} to ${Math.max(...line)}`);
  await whole(page, 'profile');

  await page.waitForTimeout(600);
  const linked = await shot(page, 'linked'), link = await page.evaluate(() => location.href);
  const other = await tab(link);
  await still(other);
  // Over the ground one says the place that was clicked, the other what to do: under two hundredths of the picture.
  expect(await differ(page, linked, await shot(other, 'link')) < 0.03, `${link} shows another picture`);
  await other.waitForTimeout(600);
  expect(await other.evaluate(() => location.href) === link, `${link} became ${await other.evaluate(() => location.href)}`);
  expect(other.said.length === 0, `the console says ${other.said}`);
  await other.context().close();

  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#screenshot')]);
  expect(readFileSync(await download.path()).subarray(1, 4).toString() === 'PNG', 'the screenshot is no PNG');
  await page.locator('#canvas').focus();
  const before = await page.evaluate(() => location.hash);
  for (const key of ['ArrowLeft', 'ArrowUp', 'Shift+ArrowRight', '+']) await page.keyboard.press(key);
  await still(page);
  await page.waitForTimeout(600);
  expect(await page.evaluate(() => location.hash) !== before, 'arrows do not turn the view');
  await page.click('#profile-mode');
  await page.locator('#canvas').focus();
  await page.keyboard.press('Enter');
  await page.waitForFunction(() => /^x /.test(document.querySelector('#readout').textContent));
  const unnamed = await nameless(page);
  expect(unnamed.length === 0, `controls without a name: ${unnamed}`);
  expect((await fetch(`${lodUrl}licences.txt`)).status === 200, 'the licences are not there');
  expect(page.said.length === 0, `the console says ${page.said.slice(0, 3)}`);
  await page.context().close();

  const dark = await tab(lodUrl, { scheme: 'dark' });
  await still(dark);
  const ground = (p) => p.evaluate(() => getComputedStyle(document.querySelector('#stage')).backgroundColor);
  expect(/^rgb\((\d|[1-5]\d),/.test(await ground(dark)), `dark is ${await ground(dark)}`);
  await whole(dark, 'dark');
  expect(dark.said.length === 0, `the console says ${dark.said}`);
  await dark.context().close();
}

// A run.
{
  const page = await tab(runUrl);
  await still(page);
  const plain = await shot(page, 'run');
  await page.selectOption('#field', 's1000/deviation.tif');
  await page.waitForFunction(() => !document.querySelector('#colour-scale').hidden);
  const coloured = await shot(page, 'deviation');
  expect(await differ(page, plain, coloured) > 0.1, 'deviations have no colour');
  await page.fill('#brush-low', '0.05');
  await page.locator('#brush-low').press('Tab');
  expect(await differ(page, coloured, await shot(page, 'brush')) > 0.1, 'the brush changes nothing');
  await whole(page, 'brush_page');
  // Dragged over the histogram: what was passed keeps its colour; a click lets all have theirs.
  await page.click('#brush-all');
  await page.locator('#histogram').scrollIntoViewIfNeeded();
  const span = await page.locator('#histogram').boundingBox(), most = +(await page.inputValue('#limit'));
  const over = (share) => [span.x + share * span.width, span.y + 0.5 * span.height];
  await page.mouse.move(...over(0.85));
  await page.mouse.down();
  for (const share of [0.8, 0.7, 0.6]) await page.mouse.move(...over(share));
  await page.mouse.up();
  for (const [id, share] of [['#brush-low', 0.6], ['#brush-high', 0.85]]) {
    const typed = +(await page.inputValue(id)), meant = most * (2 * share - 1);
    // A pixel of the histogram, and three digits.
    expect(Math.abs(typed - meant) < 2 * most / span.width + 0.005 * most, `dragged to ${share} of ±${most}: ${id} is ${typed}`);
  }
  expect(await differ(page, coloured, await shot(page, 'brush_dragged')) > 0.1, 'dragging changes nothing');
  const keep = /([\d.]+) % of the places/.exec(await page.locator('#histogram').getAttribute('aria-label'));
  expect(keep && +keep[1] > 0 && +keep[1] < 100, `of the dragged span is said: ${keep}`);
  await page.mouse.click(...over(0.3));
  expect(await page.inputValue('#brush-low') === '' && await page.inputValue('#brush-high') === '', 'a click does not let go of the span');
  expect(await differ(page, coloured, await shot(page, 'brush_gone')) < 0.01, 'after a click colours are others');
  const { text, place } = await ask(page, 380, 350);
  const [z] = await (await fetch(`${runUrl}profile?file=s1000/surface.tif&from=${place[0]},${place[1]}&to=0,0&count=1`)).json().then((j) => j.values);
  // Three decimals, and the slope of a stone's side between 0.5 um of x and y.
  expect(Math.abs(place[2] - z) < 0.003, `${text}: surface.tif is ${z} there`);

  // Residuals of a diagnosis, before and after: one scale, side by side.
  const [before, after] = ['before', 'after'].map((when) => `diagnosis/residual_${when}.tif`);
  await page.selectOption('#field', before);
  await page.waitForFunction((file) => [...document.querySelector('#field-beside').options].some((o) => o.value === file), after);
  await page.click('#above');
  const one = await shot(page, 'residual'), limit = await page.inputValue('#limit');
  expect(await differ(page, plain, one) > 0.1, 'residuals have no colour');
  await page.fill('#brush-low', '0.1');
  await page.locator('#brush-low').press('Tab');
  expect(await differ(page, one, await shot(page, 'residual_brush')) > 0.02, 'the brush changes no residuals');
  await page.click('#brush-all');
  const bars = await page.locator('#histogram').innerHTML();
  await page.selectOption('#field', after);
  await page.waitForFunction((old) => document.querySelector('#histogram').innerHTML !== old, bars);
  expect(await differ(page, one, await shot(page, 'residual_after')) > 0.03, 'residuals after are those before');
  expect(await page.inputValue('#limit') === limit, `before to ${limit}, after to ${await page.inputValue('#limit')}`);
  await page.selectOption('#field', before);
  await page.selectOption('#field-beside', after);
  await page.waitForFunction(() => !document.querySelector('#right-name').hidden);
  expect(await page.locator('#right-name').textContent() === after, 'the right pane has another name');
  await page.click('#above');
  await still(page);
  expect(await page.locator('#histogram path').count() === 1, 'the second field is not in the histogram');
  const canvas = await page.locator('#canvas').boundingBox(), pair = await ask(page, Math.round(canvas.width / 4) + 5, Math.round(canvas.height / 2) + 5);
  const value = async (file) => (await (await fetch(`${runUrl}profile?file=${file}&from=${pair.place[0]},${pair.place[1]}&to=0,0&count=1`)).json()).values[0];
  for (const file of [before, after]) {
    const told = new RegExp(`${file} ([+-]?[\\d.]+) mm`).exec(pair.text), v = await value(file);
    // Four decimals, and half a micrometre along a step between two cells of half a mm.
    // Beside a void the server has none, and the page says that of the nearest cell.
    expect(v === null || (told && Math.abs(told[1] - v) < 0.005), `${pair.text}: ${file} is ${v} there`);
  }
  await whole(page, 'residual_pair');
  await page.waitForTimeout(600);
  const pairLink = await page.evaluate(() => location.href), again = await tab(pairLink);
  await still(again);
  expect(await again.locator('#field-beside').inputValue() === after && await again.locator('#right-name').isVisible(), `${pairLink} is another view`);
  await again.context().close();
  await page.selectOption('#field', '');
  await page.waitForFunction(() => document.querySelector('#right-name').hidden);
  await page.click('#oblique');
  await still(page);
  const programs = await page.locator('#program option').evaluateAll((list) => list.map((o) => [o.value, o.text]));
  const raster = programs.find((p) => p[1].includes('raster'));
  expect(raster, `programs: ${programs}`);
  await page.selectOption('#program', raster[0]);
  await page.waitForFunction(() => !document.querySelector('#path-controls').hidden);
  const path = await shot(page, 'toolpath');
  expect(await differ(page, plain, path) > 0.05, 'the toolpath is not to be seen');
  await slide(page, '#time', 0.4);
  expect(await differ(page, path, await shot(page, 'toolpath_40')) > 0.03, 'the time changes nothing');
  await page.selectOption('#path-colour', 'engagement');
  await page.selectOption('#speed', '300');
  await page.click('#play');
  await page.waitForFunction(() => +document.querySelector('#time').value > 0.42);
  await page.click('#play');
  await still(page);
  await whole(page, 'engagement');
  await page.selectOption('#program', '');
  await page.selectOption('#beside', 's1000/as_milled.tif');
  await page.waitForFunction(() => !document.querySelector('#right-name').hidden);
  await still(page);
  const right = await ask(page, 0.75 * (await page.locator('#canvas').boundingBox()).width, 380);
  const [milled] = await (await fetch(`${runUrl}profile?file=s1000/as_milled.tif&from=${right.place[0]},${right.place[1]}&to=0,0&count=1`)).json().then((j) => j.values);
  expect(Math.abs(right.place[2] - milled) < 0.003, `${right.text}: as_milled.tif is ${milled} there`);
  await whole(page, 'beside');
  await page.selectOption('#beside', '');
  await page.selectOption('#frame', 's1000/scene.toml');
  await page.waitForFunction(() => !document.querySelector('#shot').hidden && document.querySelector('#shot').complete);
  await still(page);
  await whole(page, 'camera');

  // Cameras where they stand: a click on one shows its picture, which is what is seen from there.
  await page.selectOption('#frame', '');
  await page.click('#oblique');
  for (let i = 0; i < 12; i += 1) { await page.locator('#canvas').focus(); await page.keyboard.press('-'); }
  await still(page);
  const names = await page.locator('#frame option').evaluateAll((list) => list.map((o) => o.value));
  const photo = 's1000/photo.toml shot.exr', ring = [1, 2, 3].map((i) => `s1000/ring.toml 000${i}`);
  for (const name of [photo, ...ring]) expect(names.includes(name), `of cameras there are ${names}`);
  const open = async (name) => {
    await page.waitForFunction((text) => document.querySelector('#photo-text').textContent.startsWith(text)
      && document.querySelector('#photo-picture').complete && document.querySelector('#photo-picture').naturalWidth === 240, `${name}:`);
  };
  // The apex of the first pose, as the page's camera sees it.
  const link0 = new URLSearchParams(await page.evaluate(() => new Promise((resolve) => { setTimeout(() => resolve(location.hash.slice(1)), 600); })));
  const [from0, to0] = ['from', 'to'].map((k) => link0.get(k).split(',').map(Number)), area = await page.locator('#canvas').boundingBox();
  const eye0 = [20 + 110 * Math.sin(-0.5), 20 - 110 * Math.cos(-0.5), 90];
  const minus = (a, b) => a.map((v, i) => v - b[i]), dot = (a, b) => a.reduce((s, v, i) => s + v * b[i], 0);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], unit = (a) => a.map((v) => v / Math.hypot(...a));
  const ahead = unit(minus(to0, from0)), aside = unit(cross(ahead, [0, 0, 1])), upward = cross(aside, ahead), way = minus(eye0, from0);
  const scale = 0.5 * area.height / Math.tan(20 * Math.PI / 180) / dot(way, ahead);
  await page.locator('#canvas').click({ position: { x: 0.5 * area.width + scale * dot(way, aside), y: 0.5 * area.height - scale * dot(way, upward) } });
  await open(ring[0]);
  await still(page);
  await whole(page, 'photo_ring');
  expect(await page.locator('#photo-before').isDisabled(), 'there is something before the first');
  await page.click('#photo-next');
  await open(ring[1]);
  const rendered = await page.locator('#photo-picture').screenshot();
  expect((await page.locator('#photo-text').textContent()).includes('at 0.5 s'), `of the second is said ${await page.locator('#photo-text').textContent()}`);
  await page.selectOption('#frame', photo);
  await page.click('#frame-photo');
  await open(photo);
  expect((await page.locator('#photo-text').textContent()).includes('held out'), 'that it is held out is not said');
  // Light in the one file, sRGB in the other; the same picture.
  expect(await differ(page, rendered, await page.locator('#photo-picture').screenshot()) < 0.02, 'the photograph is not the rendering');
  await page.click('#photo-look');
  await page.fill('#shot-opacity', '0.5');
  await still(page);
  await whole(page, 'photo_look');
  await page.waitForTimeout(600);
  const photoLink = await page.evaluate(() => location.href);
  expect(photoLink.includes('photo='), `${photoLink} has no photograph`);
  await page.click('#photo-close');
  expect(await page.locator('#photo').isHidden(), 'the picture does not close');

  // From straight above and turned, and turned about its axis: a place is where the camera's pose has it.
  const csv = readFileSync(join(runFolder, 's1000/ring.csv'), 'utf8').trim().split('\n').slice(1).map((line) => line.split(',').map(Number));
  for (const i of [4, 5]) {
    const [, x, y, z, qw, ...q] = csv[i - 1], name = `s1000/ring.toml 000${i}`;
    await page.selectOption('#frame', name);
    await still(page);
    await whole(page, `turned_${i}`);
    const canvas = await page.locator('#canvas').boundingBox();
    const focal = Math.min(canvas.height, canvas.width * 160 / 240) / 160 * 30 / 0.05; // pixels of the page
    // model_from_camera the other way round.
    const back = (v) => { const t = cross(v, q).map((c) => 2 * c), u = cross(t, q); return v.map((c, k) => c + qw * t[k] + u[k]); };
    for (const [du, dv] of [[0, 0], [90, 40], [-70, 60], [30, -80]]) {
      const u = Math.round(canvas.width / 2 + du), v = Math.round(canvas.height / 2 + dv);
      const { place } = await ask(page, u, v), p = back(minus(place, [x, y, z]));
      const off = [canvas.width / 2 - focal * p[0] / p[2] - u, canvas.height / 2 + focal * p[1] / p[2] - v];
      expect(Math.hypot(...off) < 1, `${name}: ${place} is ${off} pixels beside where it was asked for`);
    }
  }
  await page.locator('#canvas').focus();
  await page.keyboard.press('ArrowLeft');
  expect(await page.locator('#frame').inputValue() === '' && await page.locator('#shot').isHidden(), 'a key that turns the view leaves the picture over it');
  const bad = await fetch(`${runUrl}picture?file=s1000/design.tif&most=0`), outside = await fetch(`${runUrl}picture?file=../site.toml&most=100`);
  expect(bad.status === 400 && outside.status === 404, `bad pictures: ${bad.status}, ${outside.status}`);
  expect(page.said.length === 0, `the console says ${page.said.slice(0, 3)}`);
  await page.context().close();
}

// Residuals alone, without a surface.
{
  const page = await tab(await serve(join(runFolder, 'diagnosis')));
  await still(page);
  expect((await page.locator('#surface-note').textContent()).includes('even ground'), 'what the colours lie on is not said');
  await page.selectOption('#field', 'residual_before.tif');
  await still(page);
  await page.locator('#canvas').click({ position: { x: 380, y: 380 } });
  await page.waitForFunction(() => /^x [\d.]+, y [\d.]+ mm; residual_before.tif/.test(document.querySelector('#readout').textContent));
  await whole(page, 'residual_alone');
  expect(page.said.length === 0, `the console says ${page.said.slice(0, 3)}`);
  await page.context().close();
}

// Damage.
{
  const broken = `${lodFolder}_broken`;
  cpSync(lodFolder, broken, { recursive: true });
  const depth = lod.levels[0].depth;
  truncateSync(join(broken, `tiles/${depth}/0/0.glb`), 200);
  rmSync(join(broken, `tiles/${depth}/1/1.glb`));
  const page = await tab(await serve(broken), { expected: ['Failed to load', 'DRACOLoader', 'RangeError', '404'] });
  await still(page);
  // Near enough for the finest tiles of the south-western corner.
  await go(page, [16, -6, 24], [18, 14, 2]);
  await page.waitForFunction(() => document.querySelectorAll('#problems li').length >= 2);
  const problems = await page.locator('#problems').innerText();
  for (const name of [`tiles/${depth}/0/0.glb`, `tiles/${depth}/1/1.glb`])
    expect(problems.includes(name) && problems.includes('coarser ground stands for it'), `of ${name} is said: ${problems}`);
  await still(page);
  await whole(page, 'damaged');
  await page.click('#above');
  await still(page);
  const box = await page.locator('#canvas').boundingBox();
  const [cx, cy] = [Math.round(box.width / 2), Math.round(box.height / 2)];
  const coarse = await ask(page, cx + 20, cy - 20);
  expect(coarse.text.includes('as drawn; the full resolution cannot be read'), `on a missing tile: ${coarse.text}`);
  // The corner of another tile.
  const { text, place } = await ask(page, cx + 190, cy - 190);
  const [z] = await design(place.slice(0, 2), place.slice(0, 2), 1);
  expect(text.includes('stone') || Math.abs(place[2] - z) < kHeight, `beside damaged tiles: ${text}, the design is ${z}`);
  await page.context().close();

  // The coarsest tile of all: finer ones take its place.
  const rootless = `${lodFolder}_rootless`;
  cpSync(lodFolder, rootless, { recursive: true });
  truncateSync(join(rootless, 'tiles/0/0/0.glb'), 200);
  const bare = await tab(await serve(rootless), { expected: ['Failed to load', 'DRACOLoader', 'RangeError'] });
  await bare.waitForFunction(() => document.querySelector('#problems').textContent.includes('tiles/0/0/0.glb cannot be shown'));
  await still(bare);
  await bare.click('#above');
  await still(bare);
  const there = await ask(bare, cx + 190, cy - 190), [zThere] = await design(there.place.slice(0, 2), there.place.slice(0, 2), 1);
  expect(there.text.includes('stone') || Math.abs(there.place[2] - zThere) < kHeight, `without the coarsest tile: ${there.text}, the design is ${zThere}`);
  await whole(bare, 'rootless');
  await bare.context().close();

  const blind = await tab(lodUrl, { before: () => {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) { return kind === 'webgl2' ? null : get.call(this, kind, ...rest); };
  } });
  await blind.waitForFunction(() => document.querySelector('#problems').textContent.includes('WebGL 2'));
  expect(blind.said.length === 0, `without WebGL 2 the console says ${blind.said}`);
  await blind.context().close();
}

await close();
finish('the page of maquette view');
