// SPDX-License-Identifier: GPL-3.0-or-later
// What the folder holds, as tools/view/view_contents.hpp says it: from the server, or from the page itself
// where it was exported with its data inside.

import { carriedBytes, carriedGrid, carriedJson, carriedUrl, carries } from './carried';
import { heightOn } from './height_on';

export interface TilesetEntry { path: string; lod: string | null; stones: string | null }
export interface FieldEntry {
  path: string; kind: 'height' | 'signed' | 'positive'; unit: string;
  nodes: [number, number]; spacing_mm: number; origin_mm: [number, number];
}
export interface FrameEntry {
  name: string; kind: 'scene' | 'trajectory' | 'photo'; scene: string; picture: string | null; linear: boolean;
  time_s?: number; held_out?: boolean; position_mm: Triple; target_mm: Triple; up: Triple;
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
  loss?: Loss;
}
export interface Stone {
  number: number; scale_mm: number; translation_mm: Triple; rotation_wxyz: [number, number, number, number];
  embedded_depth_mm: number;
}

/** What an exported page carries has lost, in mm; a served raster has not. */
export interface Loss { most_mm: number; rms_mm: number }

async function answer(url: string): Promise<Response> {
  const response = await fetch(url);
  if (response.ok) return response;
  const said = await response.json().catch(() => ({}));
  throw new Error(said.error ?? `${url}: ${response.status} ${response.statusText}`);
}

/** Address of a file of the folder, of a server. */
export function fileUrl(path: string): string {
  return 'files/' + path.split('/').map(encodeURIComponent).join('/');
}

export async function getContents(): Promise<Contents> {
  return carries ? carriedJson('maquette.json') : (await answer('maquette.json')).json();
}

export async function getFile(path: string): Promise<ArrayBuffer> {
  return carries ? carriedBytes(`files/${path}`) : (await answer(fileUrl(path))).arrayBuffer();
}

export async function getJson<T>(path: string): Promise<T> {
  return carries ? carriedJson(`files/${path}`) : (await answer(fileUrl(path))).json();
}

const kPicturePixels = 2048; // a side

/** Address of a camera's picture, for an element. */
export async function pictureUrl(frame: FrameEntry): Promise<string> {
  const path = frame.picture!;
  if (carries) return carriedUrl(`files/${path}`, 'image/png');
  if (!frame.linear && /\.(png|jpg)$/.test(path)) return fileUrl(path);
  return `picture?file=${encodeURIComponent(path)}&most=${kPicturePixels}${frame.linear ? '&linear=1' : ''}`;
}

/** A raster, thinned to at most so many nodes a side; an exported page has it as it carries it. */
export async function getGrid(path: string, nodes: number, mean: boolean): Promise<Grid> {
  if (carries) return carriedGrid(path);
  const response = await answer(`grid?file=${encodeURIComponent(path)}&nodes=${nodes}${mean ? '&mean=1' : ''}`);
  const shape = JSON.parse(response.headers.get('maquette-grid') ?? '{}');
  return { ...shape, values: new Float32Array(await response.arrayBuffer()) };
}

/** Every n-th node of a square with one more around it (tools/view/view_fields.hpp: every_nth). */
export async function getTile(path: string, row: number, col: number, every: number, quads: number): Promise<Float32Array> {
  const url = `tile?file=${encodeURIComponent(path)}&row=${row}&col=${col}&every=${every}&quads=${quads}`;
  return new Float32Array(await (await answer(url)).arrayBuffer());
}

/** The raster itself on a line, null where it has no value. */
export async function getProfile(path: string, from: number[], to: number[], count: number): Promise<(number | null)[]> {
  if (carries) {
    const g = await carriedGrid(path);
    return Array.from({ length: count }, (_, i) => {
      const t = count < 2 ? 0 : i / (count - 1);
      const at = (k: 0 | 1) => from[k]! + t * (to[k]! - from[k]!);
      const v = heightOn(g.values, g.cols, g.rows, (at(0) - g.x0_mm) / g.dx_mm, (at(1) - g.y0_mm) / g.dy_mm);
      return Number.isNaN(v) ? null : v;
    });
  }
  const at = (p: number[]) => `${p[0]},${p[1]}`;
  const url = `profile?file=${encodeURIComponent(path)}&from=${at(from)}&to=${at(to)}&count=${count}`;
  return (await (await answer(url)).json() as { values: (number | null)[] }).values;
}
