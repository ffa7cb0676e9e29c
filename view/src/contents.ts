// SPDX-License-Identifier: GPL-3.0-or-later
// What the folder holds, as tools/view/view_contents.hpp says it.

export interface TilesetEntry { path: string; lod: string | null; stones: string | null }
export interface FieldEntry {
  path: string; kind: 'height' | 'signed' | 'positive'; unit: string;
  nodes: [number, number]; spacing_mm: number; origin_mm: [number, number];
}
export interface FrameEntry {
  scene: string; picture: string | null; position_mm: Triple; target_mm: Triple; up: Triple;
  across_mm: number; down_mm: number; focal_mm: number;
}
export type Triple = [number, number, number];
export interface Contents {
  schema: string; name: string; manifest: string | null;
  tilesets: TilesetEntry[]; fields: FieldEntry[]; plans: string[]; paths: string[];
  frames: FrameEntry[]; reports: string[];
}
export interface Grid {
  rows: number; cols: number; x0_mm: number; y0_mm: number; dx_mm: number; dy_mm: number; whole: boolean;
  values: Float32Array;
}
export interface Stone {
  number: number; scale_mm: number; translation_mm: Triple; rotation_wxyz: [number, number, number, number];
  embedded_depth_mm: number;
}

/** Address of a file of the folder. */
export function fileUrl(path: string): string {
  return 'files/' + path.split('/').map(encodeURIComponent).join('/');
}

async function answer(url: string): Promise<Response> {
  const response = await fetch(url);
  if (response.ok) return response;
  const said = await response.json().catch(() => ({}));
  throw new Error(said.error ?? `${url}: ${response.status} ${response.statusText}`);
}

export async function getJson<T>(url: string): Promise<T> {
  return (await answer(url)).json();
}

/** A raster, thinned to at most so many nodes a side. */
export async function getGrid(path: string, nodes: number, mean: boolean): Promise<Grid> {
  const response = await answer(`grid?file=${encodeURIComponent(path)}&nodes=${nodes}${mean ? '&mean=1' : ''}`);
  const shape = JSON.parse(response.headers.get('maquette-grid') ?? '{}');
  return { ...shape, values: new Float32Array(await response.arrayBuffer()) };
}

/** The raster itself on a line, null where it has no value. */
export async function getProfile(path: string, from: number[], to: number[], count: number): Promise<(number | null)[]> {
  const at = (p: number[]) => `${p[0]},${p[1]}`;
  const url = `profile?file=${encodeURIComponent(path)}&from=${at(from)}&to=${at(to)}&count=${count}`;
  return (await getJson<{ values: (number | null)[] }>(url)).values;
}
