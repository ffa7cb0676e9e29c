// SPDX-License-Identifier: GPL-3.0-or-later

// node view_first.mjs MAQUETTE FOLDER...: how soon the page shows something of each folder
//   the first picture stands within 3 s of the page's being asked for
// The least of up to five loads counts, and a machine that has more to do than it has cores is given
// as many times longer, which is said. At full size (16 M quads) a set takes a minute to make, and the
// page asks for the same few coarse tiles first; the folders here are the largest that the tests have.

import { cpus, loadavg } from 'node:os';
import { look } from './looking.mjs';
import { expect, finish } from './packages.mjs';

const kTries = 5, busy = Math.max(1, loadavg()[0] / cpus().length), kMost = 3000 * busy; // ms
if (busy > 1) console.log(`the machine is busy: ${(0.001 * kMost).toFixed(1)} s instead of 3 s`);

const [maquette, ...folders] = process.argv.slice(2);
const { serve, tab, close } = await look(maquette);
for (const folder of folders) {
  const url = await serve(folder), took = [];
  while (took.length < kTries && !(Math.min(...took) <= kMost)) {
    const page = await tab(url);
    await page.waitForFunction(() => document.documentElement.dataset.firstPicture);
    took.push(+(await page.evaluate(() => document.documentElement.dataset.firstPicture)));
    expect(page.said.length === 0, `${folder}: the console says ${page.said.slice(0, 3)}`);
    await page.context().close();
  }
  console.log(`${folder}: first picture after ${took.join(', ')} ms`);
  expect(Math.min(...took) <= kMost, `${folder}: the first picture takes ${took} ms`);
}
await close();
finish('first pictures');
