// SPDX-License-Identifier: GPL-3.0-or-later

// Other people's software from node_modules (tools/setup --web). Where something is not
// there the test is skipped: exit code 77, with the reason.

import { existsSync } from 'node:fs';
import { createRequire } from 'node:module';
import { fileURLToPath } from 'node:url';

export const here = fileURLToPath(new URL('./', import.meta.url));
const require = createRequire(here);

export function skip(reason) {
  console.log(`skipped: ${reason}; tools/setup --web installs it`);
  process.exit(77);
}

/** A package by its name; skips where it is not installed. */
export function load(name) {
  try {
    return require(name);
  } catch (error) {
    if (error.code === 'MODULE_NOT_FOUND') skip(`${name} is not installed`);
    throw error;
  }
}

/** Debian's browser without a window; skips where there is none. */
export async function browser() {
  const executablePath = ['/usr/bin/chromium', '/usr/bin/chromium-browser'].find(existsSync);
  if (!executablePath) skip('there is no Chromium');
  return load('playwright-core').chromium.launch({
    executablePath,
    args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
  });
}

let failures = 0;
export function expect(holds, what) {
  if (holds) return;
  failures += 1;
  if (failures <= 20) console.error(`FAILED: ${what}`);
}
export function finish(summary) {
  console.log(`${summary}; ${failures} failure${failures === 1 ? '' : 's'}`);
  process.exit(failures === 0 ? 0 : 1);
}
