// SPDX-License-Identifier: GPL-3.0-or-later

// node view_wide.mjs MAQUETTE RUN [FOLDER]: the page over a raster that has more nodes than are shown
// at once, without tiles of maquette lod; pictures go to FOLDER
//   near enough every node is there, far away fewer       squares that are asked for
//   a click gives the file's height, far away and near
//   nothing shines through between squares of two levels  a background of a colour that nothing has
//   a part that does not come is said, coarser ground stands for it

import { look } from './looking.mjs';
import { expect, finish } from './packages.mjs';

const [maquette, runFolder, pictures] = process.argv.slice(2);
const { serve, tab, still, ask, shot, whole, go, close } = await look(maquette, pictures);
const url = await serve(runFolder), file = 's1000/design.tif';
const height = async ([x, y]) => (await (await fetch(`${url}profile?file=${file}&from=${x},${y}&to=0,0&count=1`)).json()).values[0];
const nodes = (await (await fetch(`${url}maquette.json`)).json()).fields.find((f) => f.path === file).nodes;
expect(nodes[0] > 501, `${file} has ${nodes} nodes`);

/** Counts pixels of the canvas that have the background's colour. */
const holes = async (page, name) => {
  const png = (await shot(page, name)).toString('base64');
  return page.evaluate(async (data) => {
    const image = new Image();
    image.src = `data:image/png;base64,${data}`;
    await image.decode();
    const c = new OffscreenCanvas(image.width, image.height), pen = c.getContext('2d');
    pen.drawImage(image, 0, 0);
    const p = pen.getImageData(0, 0, c.width, c.height).data;
    let n = 0;
    for (let i = 0; i < p.length; i += 4) if (p[i] > 200 && p[i + 1] < 80 && p[i + 2] > 200) n += 1;
    return n;
  }, png);
};

{
  const asked = new Map();
  const page = await tab('about:blank');
  page.on('request', (q) => { const every = /tile\?.*every=(\d+)/.exec(q.url()); if (every) asked.set(+every[1], (asked.get(+every[1]) ?? 0) + 1); });
  await page.goto(url);
  await still(page);
  console.log(`first picture after ${await page.evaluate(() => document.documentElement.dataset.firstPicture)} ms`);
  await page.evaluate(() => { document.querySelector('#stage').style.background = 'rgb(255, 0, 255)'; });
  await page.click('#above');
  await still(page);
  const box = await page.locator('#canvas').boundingBox(), [cx, cy] = [Math.round(box.width / 2), Math.round(box.height / 2)];
  for (const [dx, dy] of [[1, 1], [120, 40], [-90, 110]]) {
    const { text, place } = await ask(page, cx + dx, cy + dy), z = await height(place);
    // Three decimals, and a slope of one between half a micrometre of x and y.
    expect(Math.abs(place[2] - z) < 0.0015, `${text}: the file has ${z} there`);
  }
  const middle = await height([200, 200]);
  // Over the ground, to the horizon: near squares beside far ones.
  await go(page, [200, 60, middle + 30], [200, 130, middle]);
  await still(page);
  await holes(page, 'wide_oblique');
  await go(page, [200, 196, middle + 60], [200, 204, middle]);
  await still(page);
  expect(asked.get(1) > 0, `near were asked for ${JSON.stringify([...asked])}`);
  const near = await ask(page, cx + 3, cy - 5), z = await height(near.place);
  expect(Math.abs(near.place[2] - z) < 0.0015, `${near.text}: the file has ${z} there`);
  expect(await holes(page, 'wide_near') === 0, 'the ground has holes');
  // From above, so that the ground fills the picture and two levels are in it.
  await page.click('#above');
  await page.locator('#canvas').focus();
  for (let i = 0; i < 7; i += 1) await page.keyboard.press('+');
  await still(page);
  expect(await holes(page, 'wide_above') === 0, 'the ground has holes from above');
  await page.fill('#exaggeration', '5');
  await still(page);
  await whole(page, 'wide_exaggerated');
  expect(page.said.length === 0, `the console says ${page.said.slice(0, 3)}`);
  await page.context().close();
}

// What does not come.
{
  const page = await tab('about:blank', { expected: ['Failed to load'] });
  await page.route(/tile\?.*every=1&/, (route) => route.abort());
  await page.goto(url);
  await still(page);
  const middle = await height([200, 200]);
  await go(page, [200, 196, middle + 60], [200, 204, middle]);
  await page.waitForFunction(() => document.querySelector('#problems').textContent.includes('coarser ground stands for it'));
  await still(page);
  const box = await page.locator('#canvas').boundingBox();
  const { text, place } = await ask(page, Math.round(box.width / 2), Math.round(box.height / 2)), z = await height(place);
  expect(Math.abs(place[2] - z) < 0.0015, `${text}: the file has ${z} there`);
  await whole(page, 'wide_damaged');
  await page.context().close();
}

await close();
finish('a raster with more nodes than are shown at once');
