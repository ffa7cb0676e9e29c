// SPDX-License-Identifier: GPL-3.0-or-later
import { defineConfig, type Plugin } from 'vite';

/** The decoders that three.js would look for by itself; the page names the ones that it uses. */
const oneDecoder: Plugin = {
  name: 'one-decoder',
  enforce: 'pre',
  transform(code, id) {
    if (!id.endsWith('/DRACOLoader.js')) return null;
    return code.replace(/new URL\( '\.\.\/libs\/draco\/[^']*', import\.meta\.url \)\.toString\(\)/g, "''");
  },
};

export default defineConfig({
  base: './',
  plugins: [oneDecoder],
  build: { target: 'es2022', chunkSizeWarningLimit: 2000, assetsInlineLimit: 0, license: { fileName: 'licences.txt' } },
});
