// SPDX-License-Identifier: GPL-3.0-or-later

// node view_export.mjs MAQUETTE LOD RUN [FOLDER]: pages with their data inside (maquette view
// --export), opened from the disk in a real browser; pictures go to FOLDER
//   nothing is asked of anybody, nothing on the console
//   a click gives the place and the height       the served file's, within what the page says
//   deviations, brush, toolpath, stones, camera, profile, link, as from the server
//   damage is said and the rest works; so is a browser without WebGL 2
//   what is coarser says so, and by how much      little room; tiles without the finest levels

import { readFileSync, statSync, writeFileSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { look } from './looking.mjs';
import { expect, finish } from './packages.mjs';

const [maquette, lodFolder, runFolder, pictures] = process.argv.slice(2);
const { serve, run, tab, still, ask, differ, shot, whole, nameless, close } = await look(maquette, pictures);

async function write(folder, name, mb) {
  const { code, err } = await run('view', folder, '--export', name, '--export-mb', String(mb), '--quiet');
  expect(code === 0, `export of ${folder}: ${code} ${err}`);
  const size = statSync(name).size;
  expect(size <= 1e6 * mb, `${name} weighs ${size}`);
  console.log(`${name}: ${(1e-6 * size).toFixed(2)} MB`);
  return `file://${resolve(name)}`;
}
const middle = async (page) => {
  const box = await page.locator('#canvas').boundingBox();
  return [Math.round(box.width / 2), Math.round(box.height / 2)];
};
const runUrl = await serve(runFolder);
const served = async (file, [x, y]) =>
  (await (await fetch(`${runUrl}profile?file=${file}&from=${x},${y}&to=0,0&count=1`)).json()).values[0];

// A run.
{
  const page = await tab(await write(runFolder, 'site.html', 10));
  await still(page);
  console.log(`first picture after ${await page.evaluate(() => document.documentElement.dataset.firstPicture)} ms`);
  expect((await page.locator('#carried-note').textContent()).includes('Nothing was left out'), 'something was left out');
  const note = /within ([\d.e-]+) mm of the file/.exec(await page.locator('#surface-note').textContent());
  expect(note, `of the surface is said: ${await page.locator('#surface-note').textContent()}`);
  await whole(page, 'export');
  await page.click('#above');
  const plain = await shot(page, 'export_above'), [cx, cy] = await middle(page);
  const { text, place } = await ask(page, cx + 31, cy - 57);
  // Three decimals, and a slope of two between half a micrometre of x and y.
  const z = await served('s1000/surface.tif', place);
  expect(Math.abs(place[2] - z) < +note[1] + 0.0025, `${text}: surface.tif is ${z} there`);
  await page.selectOption('#field', 's1000/deviation.tif');
  await page.waitForFunction(() => !document.querySelector('#colour-scale').hidden);
  const coloured = await shot(page, 'export_deviation');
  expect(await differ(page, plain, coloured) > 0.1, 'deviations have no colour');
  const asked = await ask(page, cx - 41, cy + 33), told = /deviation\.tif ([+-][\d.]+) mm/.exec(asked.text);
  const deviation = await served('s1000/deviation.tif', asked.place);
  expect(told && Math.abs(told[1] - deviation) < 0.001, `${asked.text}: deviation.tif is ${deviation} there`);
  await page.fill('#brush-low', '0.05');
  await page.locator('#brush-low').press('Tab');
  expect(await differ(page, coloured, await shot(page, 'export_brush')) > 0.1, 'the brush changes nothing');
  await page.selectOption('#field', 'diagnosis/residual_before.tif');
  await page.selectOption('#field-beside', 'diagnosis/residual_after.tif');
  await page.waitForFunction(() => !document.querySelector('#right-name').hidden);
  await page.selectOption('#field', '');
  await page.waitForFunction(() => document.querySelector('#right-name').hidden);
  const raster = await page.locator('#program option', { hasText: 'raster' }).first().getAttribute('value');
  await page.selectOption('#program', raster);
  await page.waitForFunction(() => !document.querySelector('#path-controls').hidden);
  expect(await differ(page, plain, await shot(page, 'export_toolpath')) > 0.05, 'the toolpath is not to be seen');
  await page.selectOption('#program', '');
  expect(await page.locator('#stone option').count() === 7, 'there are not six stones');
  await page.selectOption('#frame', 's1000/scene.toml');
  await page.waitForFunction(() => !document.querySelector('#shot').hidden && document.querySelector('#shot').complete
    && document.querySelector('#shot').naturalWidth > 0);
  await whole(page, 'export_camera');
  await page.selectOption('#frame', 's1000/photo.toml shot.exr');
  await page.click('#frame-photo');
  await page.waitForFunction(() => document.querySelector('#photo-picture').naturalWidth === 240);
  await page.click('#photo-close');
  await page.click('#above');
  await page.click('#profile-mode');
  await ask(page, cx - 100, cy - 50);
  await ask(page, cx + 120, cy + 70);
  await page.waitForFunction(() => document.querySelector('#profile-text').textContent.startsWith('From'));
  expect((await page.locator('#profile-text').textContent()).includes('of what this page carries'), 'the profile does not say whose heights it has');
  await page.waitForTimeout(600);
  const link = await page.evaluate(() => location.href), other = await tab(link);
  await still(other);
  await other.waitForTimeout(600);
  expect(link.includes('profile=') && await other.evaluate(() => location.href) === link,
    `${link} became ${await other.evaluate(() => location.href)}`);
  expect((await nameless(page)).length === 0, `controls without a name: ${await nameless(page)}`);
  expect((await page.locator('#licences').textContent()).includes('MIT'), 'the licences are not in the page');
  for (const p of [page, other]) expect(p.said.length === 0, `the console says ${p.said.slice(0, 3)}`);
  for (const p of [page, other]) await p.context().close();
}

// The same with little room: coarser, by how much is said, and so is what was left out.
{
  let mb = 1; // as little as does: what the page itself weighs changes
  while (mb < 2 && (await run('view', runFolder, '--export', 'small.html', '--export-mb', String(mb), '--quiet')).code !== 0) mb += 0.05;
  const page = await tab(await write(runFolder, 'small.html', mb));
  await still(page);
  const said = await page.locator('#surface-note').textContent(), note = /within ([\d.e-]+) mm of the file/.exec(said);
  expect(said.includes('41 × 41 places of 81 × 81 nodes are in this page') && note, `of the surface is said: ${said}`);
  expect((await page.locator('#carried-note').textContent()).includes('did not fit: s1000/picture.png'), 'the picture is not said to be left out');
  await page.click('#above');
  await still(page);
  const [cx, cy] = await middle(page);
  for (const [dx, dy] of [[121, 41], [-90, 110], [61, -149]]) {
    const { text, place } = await ask(page, cx + dx, cy + dy), z = await served('s1000/surface.tif', place);
    // Between nodes it may be a little more than at them.
    expect(Math.abs(place[2] - z) < 1.2 * note[1] + 0.0025, `${text}: surface.tif is ${z} there`);
  }
  expect(page.said.length === 0, `the console says ${page.said.slice(0, 3)}`);
  await page.context().close();
}

// Tiles: all levels, and all but the finest.
{
  const lod = JSON.parse(readFileSync(join(lodFolder, 'lod.json')));
  const page = await tab(await write(lodFolder, 'lod.html', 10));
  await still(page);
  await page.click('#above');
  await still(page);
  const [cx, cy] = await middle(page), { text, place } = await ask(page, cx + 121, cy + 41);
  const z = await served('s1000/design.tif', place), kHeight = lod.levels[0].max_vertical_error_mm + 0.0015;
  expect(text.includes('stone') || Math.abs(place[2] - z) < kHeight, `${text}: the design is ${z} there`);
  await whole(page, 'export_lod');
  expect(page.said.length === 0, `the console says ${page.said.slice(0, 3)}`);
  await page.context().close();

  const finest = lod.levels[0].bytes, bytes = statSync('lod.html').size;
  const coarse = await tab(await write(lodFolder, 'coarse.html', 1e-6 * (bytes - 0.5 * finest)));
  await still(coarse);
  const said = await coarse.locator('#surface-note').textContent();
  expect(said.includes('the 1 finest are not in this page'), `of fewer levels is said: ${said}`);
  await coarse.click('#above');
  await still(coarse);
  for (const [dx, dy] of [[121, 41], [-90, 110], [61, -149]]) {
    const { text, place } = await ask(coarse, cx + dx, cy + dy), z = await served('s1000/design.tif', place);
    expect(text.includes('stone') || (!text.includes('as drawn') && Math.abs(place[2] - z) < lod.levels[1].max_vertical_error_mm + 0.0015),
      `${text}: the design is ${z} there`);
  }
  await whole(coarse, 'export_coarse');
  expect(coarse.said.length === 0, `the console says ${coarse.said.slice(0, 3)}`);
  await coarse.context().close();
}

// Damage: one surface of the page, and a browser without WebGL 2.
{
  const html = readFileSync('site.html', 'utf8'), index = JSON.parse(/id="carried-index" type="application\/json">(.*?)<\/script>/s.exec(html)[1]);
  const mark = 'id="carried" type="text/plain">', start = html.indexOf(mark) + mark.length;
  const { at, size } = index.entries['grid/s1000/surface.tif'], cut = start + Math.floor((at + size / 2) / 3) * 4;
  writeFileSync('broken.html', `${html.slice(0, cut)}${'A'.repeat(64)}${html.slice(cut + 64)}`);
  const page = await tab(`file://${resolve('broken.html')}`, { expected: ['Failed to load'] });
  await page.waitForFunction(() => document.querySelector('#problems').textContent.includes('s1000/surface.tif cannot be shown'));
  await page.selectOption('#surface', 's1000/design.tif');
  await still(page);
  await page.click('#above');
  await still(page);
  const [cx, cy] = await middle(page), { text, place } = await ask(page, cx + 11, cy + 7), z = await served('s1000/design.tif', place);
  expect(Math.abs(place[2] - z) < 0.0035, `beside damage: ${text}, the design is ${z}`);
  await page.context().close();

  const blind = await tab(`file://${resolve('site.html')}`, { before: () => {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) { return kind === 'webgl2' ? null : get.call(this, kind, ...rest); };
  } });
  await blind.waitForFunction(() => document.querySelector('#problems').textContent.includes('WebGL 2'));
  await blind.context().close();
}

await close();
finish('pages with their data inside');
