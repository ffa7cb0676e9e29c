// SPDX-License-Identifier: GPL-3.0-or-later
// What a page carries that `maquette view --export` has written (tools/view/view_export.hpp).

import type { Grid } from './contents';

interface Entry { at: number; size: number; coding: 'plain' | 'deflate' | 'grid'; grid?: Record<string, number> }
interface Index { made_by: string; left_out: string[]; damaged: string[]; entries: Record<string, Entry> }

const index: Index | null = JSON.parse(document.getElementById('carried-index')?.textContent ?? 'null');
let packed: Uint8Array | null = null;
const grids = new Map<string, Promise<Grid>>();

/** The page has its data inside. */
export const carries = index !== null;
export const madeBy = index?.made_by ?? '';
export const leftOut: string[] = index?.left_out ?? [];
export const damaged: string[] = index?.damaged ?? [];

function all(): Uint8Array {
  if (!packed) {
    const element = document.getElementById('carried')!, text = atob(element.textContent!);
    packed = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i += 1) packed[i] = text.charCodeAt(i);
    element.remove(); // the text is no longer needed
  }
  return packed;
}

export async function carriedBytes(name: string): Promise<ArrayBuffer> {
  const entry = index?.entries[name];
  if (!entry) throw new Error(`${name.replace(/^(files|grid|page)\//, '')}: is not in this page`);
  const bytes = all().slice(entry.at, entry.at + entry.size);
  if (entry.coding === 'plain') return bytes.buffer;
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'))).arrayBuffer();
}

export async function carriedJson<T>(name: string): Promise<T> {
  return JSON.parse(new TextDecoder().decode(await carriedBytes(name)));
}

/** For elements and loaders that want an address. */
export async function carriedUrl(name: string, type: string): Promise<string> {
  return URL.createObjectURL(new Blob([await carriedBytes(name)], { type }));
}

/** As tools/view/packed_grid.hpp packs it. */
export function carriedGrid(path: string): Promise<Grid> {
  let grid = grids.get(path);
  if (!grid) {
    grid = unpackGrid(`grid/${path}`);
    grids.set(path, grid);
  }
  return grid;
}

async function unpackGrid(name: string): Promise<Grid> {
  const bytes = new Uint8Array(await carriedBytes(name)), about = index!.entries[name]!.grid!;
  const { rows, cols, low, step } = about as { rows: number; cols: number; low: number; step: number };
  const n = rows * cols, numbers = new Uint16Array(n), values = new Float32Array(n);
  for (let i = 0; i < n; i += 1) {
    const left = i % cols > 0, below = i >= cols;
    const expected = (left ? numbers[i - 1]! : 0) + (below ? numbers[i - cols]! : 0) - (left && below ? numbers[i - cols - 1]! : 0);
    numbers[i] = expected + 256 * bytes[i]! + bytes[n + i]!;
    values[i] = numbers[i] === 0 ? NaN : low + (numbers[i]! - 1) * step;
  }
  const { most_mm, rms_mm } = about;
  return { ...(about as unknown as Grid), values,
    ...(most_mm === undefined ? {} : { loss: { most_mm, rms_mm: rms_mm! } }) };
}
