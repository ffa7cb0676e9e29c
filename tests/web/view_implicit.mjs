// SPDX-License-Identifier: GPL-3.0-or-later

// node view_implicit.mjs MAQUETTE LOD BODY [FOLDER]: a folder of `maquette lod` whose only tileset is
// the implicit one, and one that lies on a body (BODY, of the same design), in a real browser;
// pictures go to FOLDER
//   subtrees and tiles are asked for, nothing on the console
//   the picture is that of the explicit tileset    seen from above, where errors choose fine levels
//   a click and a profile say the same heights
//   exported, tiles are named one by one: the same picture from the disk, as far down as fits
//   a click on a stone says its number             of instances, and (BODY) of stones that are one mesh
//   on the body at full size, heights halved: as many tiles, the same picture, click and profile

import { cpSync, readFileSync, rmSync } from 'node:fs';
import { join, resolve } from 'node:path';
import { look } from './looking.mjs';
import { expect, finish } from './packages.mjs';

const [maquette, lodFolder, bodyFolder, pictures] = process.argv.slice(2);
const { serve, run, tab, still, ask, differ, shot, whole, close } = await look(maquette, pictures);

const { stones } = JSON.parse(readFileSync(join(lodFolder, 'stones.json')));
const folder = `${lodFolder}_implicit`;
cpSync(lodFolder, folder, { recursive: true });
rmSync(join(folder, 'tileset.json'));

async function seen(url, name) {
  const page = await tab(url);
  await still(page);
  await whole(page, name);
  await page.click('#above');
  const picture = await shot(page, `${name}_above`);
  const box = await page.locator('#canvas').boundingBox();
  const clicks = [];
  for (const [dx, dy] of [[0, 0], [120, 40], [-90, 110]])
    clicks.push((await ask(page, Math.round(box.width / 2) + dx, Math.round(box.height / 2) + dy)).place);
  await page.click('#profile-mode');
  for (const [dx, dy] of [[-100, -50], [120, 70]])
    await ask(page, Math.round(box.width / 2) + dx, Math.round(box.height / 2) + dy);
  await page.waitForFunction(() => document.querySelector('#profile-text').textContent.startsWith('From'));
  const profile = await page.locator('#profile-text').textContent();
  await page.click('#profile-mode');
  for (const { number } of stones.slice(2, 5)) {
    await page.selectOption('#stone', String(number));
    await still(page);
    const { text } = await ask(page, Math.round(box.width / 2), Math.round(box.height / 2));
    expect(text.includes(`on a stone; stone ${number}`), `${name}: a click on stone ${number} says ${text}`);
  }
  expect(page.said.length === 0, `${name}: the console says ${page.said.slice(0, 3)}`);
  expect(await page.locator('#problems li').count() === 0, `${name}: ${await page.locator('#problems').innerText()}`);
  return { page, picture, clicks, profile, asked: await page.evaluate(() => performance.getEntriesByType('resource').map((e) => e.name)) };
}

const explicit = await seen(await serve(lodFolder), 'explicit');
const implicit = await seen(await serve(folder), 'implicit');
const names = (list, ending) => list.filter((url) => url.endsWith(ending)).length;
expect(names(explicit.asked, '.subtree') === 0, 'the explicit tileset asks for subtrees');
expect(names(implicit.asked, '.subtree') > 0, `subtrees are not asked for: ${implicit.asked}`);
expect(names(implicit.asked, '.glb') > 1, `tiles are not asked for: ${implicit.asked}`);
const alike = async (what, other) => {
  // Levels may differ where one errs less than a pixel; shading is that of the full surface in all.
  const share = await differ(explicit.page, explicit.picture, other.picture);
  expect(share < 0.02, `${what}: ${share} of the picture differs`);
  // A pixel is a tenth of a mm; the place of a click is on the triangles that are drawn.
  expect(other.profile === explicit.profile, `${what}: ${other.profile}; explicit: ${explicit.profile}`);
  other.clicks.forEach((place, i) => expect(Math.hypot(...place.map((v, k) => v - explicit.clicks[i][k])) < 0.05,
    `${what}: ${place}, the explicit tileset ${explicit.clicks[i]}`));
};
await alike('implicit', implicit);

const { code, err } = await run('view', folder, '--export', 'implicit.html', '--quiet');
expect(code === 0, `export: ${code} ${err}`);
await alike('exported', await seen(`file://${resolve('implicit.html')}`, 'implicit_export'));

const onBody = await seen(await serve(bodyFolder), 'body');
await alike('on the body', onBody);
// Errors and distances are metres of one size: levels are chosen as those of the model.
expect(names(onBody.asked, '.glb') === names(explicit.asked, '.glb'),
  `on the body ${names(onBody.asked, '.glb')} tiles are asked for, of the model ${names(explicit.asked, '.glb')}`);
const halved = await run('view', bodyFolder, '--export', 'body.html', '--quiet');
expect(halved.code === 0, `export: ${halved.code} ${halved.err}`);
await alike('on the body, exported', await seen(`file://${resolve('body.html')}`, 'body_export'));

await close();
finish('the implicit tileset, and one on a body');
