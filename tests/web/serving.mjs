// SPDX-License-Identifier: GPL-3.0-or-later

// A page for engines on loopback: packages under /node_modules/, what `maquette lod` has written
// under /data/. Nothing else is there, and no network is asked.

import { createServer } from 'node:http';
import { existsSync, readFileSync, statSync } from 'node:fs';
import { join, normalize } from 'node:path';

import { here } from './packages.mjs';

const types = { css: 'text/css', js: 'text/javascript', mcss: 'text/css', js: 'text/javascript', wasm: 'application/wasm', json: 'application/json' };

/** @param page  html of /; `folder` of the answer is what /data/ shows, and may change */
export async function serve(page) {
  const site = { folder: '', url: '', close: () => server.close() };
  const server = createServer((request, response) => {
    const path = normalize(decodeURIComponent(new URL(request.url, 'http://x').pathname));
    if (path === '/') {
      response.setHeader('content-type', 'text/html');
      response.end(page);
      return;
    }
    const file = path.startsWith('/data/') ? join(site.folder, path.slice(6)) : join(here, path);
    if (path.includes('..') || !existsSync(file) || !statSync(file).isFile()) {
      response.statusCode = 404;
      response.end();
      return;
    }
    response.setHeader('content-type', types[file.split('.').pop()] ?? 'application/octet-stream');
    response.end(readFileSync(file));
  });
  await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
  site.url = `http://127.0.0.1:${server.address().port}`;
  return site;
}
