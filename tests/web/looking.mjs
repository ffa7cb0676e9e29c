// SPDX-License-Identifier: GPL-3.0-or-later

// What the tests of the page have in common: the program's server, tabs that note whatever the
// console says and whoever is asked, clicks and pictures.

import { spawn } from 'node:child_process';
import { mkdirSync } from 'node:fs';
import { join } from 'node:path';
import { browser, expect, load, skip } from './packages.mjs';

load('playwright-core');
const kSoon = 60_000; // software rendering on a busy machine

/** @param pictures  folder that pictures go to, or nothing */
export async function look(maquette, pictures) {
  if (pictures) mkdirSync(pictures, { recursive: true });
  const chromium = await browser();

  /** The program's address; ended with the test. */
  const servers = [];
  function serve(folder) {
    return new Promise((resolve, reject) => {
      const child = spawn(maquette, ['view', folder, '--port', '0']);
      servers.push(child);
      let out = '', err = '';
      child.stdout.on('data', (d) => { out += d; if (out.includes('\n')) resolve(out.trim()); });
      child.stderr.on('data', (d) => { err += d; });
      child.on('exit', (code) => {
        if (code === 3 && err.includes('tools/setup --web')) skip('maquette was built without its page');
        expect(code === 0, `maquette view ${folder} ended with ${code}: ${err}`);
        reject(new Error(err)); // of no account where it has been asked to end
      });
    });
  }
  /** Runs the program to its end. */
  function run(...words) {
    return new Promise((resolve) => {
      const child = spawn(maquette, words);
      let out = '', err = '';
      child.stdout.on('data', (d) => { out += d; });
      child.stderr.on('data', (d) => { err += d; });
      child.on('exit', (code) => {
        if (code === 3 && err.includes('tools/setup --web')) skip('maquette was built without its page');
        resolve({ code, out, err });
      });
    });
  }

  async function tab(url, { expected = [], scheme = 'light', before, width = 1100, height = 700 } = {}) {
    const context = await chromium.newContext({ viewport: { width, height }, colorScheme: scheme, acceptDownloads: true });
    const page = await context.newPage();
    page.said = [];
    page.setDefaultTimeout(kSoon);
    page.on('console', (m) => {
      // Of 3D Tiles 1.1 the renderer always warns; the test reads pictures back.
      const known = ['tiles versions at 1.1', 'ReadPixels', ...expected].some((text) => m.text().includes(text));
      if (['error', 'warning'].includes(m.type()) && !known) page.said.push(m.text());
    });
    page.on('pageerror', (e) => page.said.push(String(e)));
    page.on('request', (q) => {
      const own = url.startsWith('file:') ? q.url().split('#')[0] === url.split('#')[0] : q.url().startsWith('http://127.0.0.1:');
      if (!own && !/^(blob:|data:)/.test(q.url())) page.said.push(`asked for ${q.url()}`);
    });
    if (before) await page.addInitScript(before);
    await page.goto(url);
    return page;
  }
  const still = async (page) => {
    await page.waitForTimeout(150);
    await page.waitForFunction(() => document.documentElement.dataset.state === 'still');
    await page.waitForTimeout(150);
  };
  const readout = (page) => page.locator('#readout').textContent();
  /** Clicks and reads what is said of the place. */
  async function ask(page, x, y) {
    const before = await readout(page);
    await page.locator('#canvas').click({ position: { x, y } });
    await page.waitForFunction((old) => document.querySelector('#readout').textContent !== old, before);
    const text = await readout(page), numbers = /x (-?[\d.]+), y (-?[\d.]+), z (-?[\d.]+) mm/.exec(text);
    expect(numbers, `a click says "${text}"`);
    return { text, place: numbers ? numbers.slice(1).map(Number) : [NaN, NaN, NaN] };
  }
  /** Share of the pixels in which two pictures of the canvas differ. */
  async function differ(page, a, b) {
    return page.evaluate(async (urls) => {
      const read = async (url) => {
        const image = new Image();
        image.src = url;
        await image.decode();
        const c = new OffscreenCanvas(image.width, image.height), pen = c.getContext('2d');
        pen.drawImage(image, 0, 0);
        return pen.getImageData(0, 0, c.width, c.height).data;
      };
      const [p, q] = [await read(urls[0]), await read(urls[1])];
      let n = 0;
      for (let i = 0; i < p.length; i += 4) if (Math.abs(p[i] - q[i]) + Math.abs(p[i + 1] - q[i + 1]) + Math.abs(p[i + 2] - q[i + 2]) > 24) n += 1;
      return n / (p.length / 4);
    }, [a, b].map((png) => `data:image/png;base64,${png.toString('base64')}`));
  }
  const shot = async (page, name) => {
    await still(page);
    return page.locator('#canvas').screenshot(pictures ? { path: join(pictures, `${name}.png`) } : {});
  };
  const whole = async (page, name) => { if (pictures) await page.screenshot({ path: join(pictures, `${name}.png`) }); };
  const slide = async (page, id, value) => { await page.locator(id).fill(String(value)); await still(page); };
  /** Another place by the address, which is there once the page has written its own; it does so again
   * where it has arrived. */
  const go = async (page, from, to) => {
    await page.waitForFunction(() => location.hash.includes('from='));
    const asked = await page.evaluate(([f, t]) => {
      location.hash = location.hash.replace(/from=[^&]*/, `from=${f}`).replace(/to=[^&]*/, `to=${t}`);
      return location.hash;
    }, [from, to].map((p) => p.join(',')));
    await page.waitForFunction((old) => location.hash !== old, asked);
    const there = new URLSearchParams((await page.evaluate(() => location.hash)).slice(1)).get('from').split(',');
    expect(there.every((v, i) => Math.abs(v - from[i]) < 0.001), `sent to ${from}, the page is at ${there}`);
  };
  /** Controls that nothing gives a name to, for screen readers. */
  const nameless = (page) => page.evaluate(() => [...document.querySelectorAll('input, select, button, canvas, a, svg, img')]
    .filter((e) => !e.closest('[aria-hidden=true]') && !e.labels?.length && !e.getAttribute('aria-label') && !e.getAttribute('alt') && !e.textContent.trim()).map((e) => e.id));
  const close = async () => {
    await chromium.close();
    await Promise.all(servers.map((child) => new Promise((resolve) => { child.on('exit', resolve); child.kill('SIGINT'); })));
  };
  return { serve, run, tab, still, readout, ask, differ, shot, whole, slide, go, nameless, close };
}
