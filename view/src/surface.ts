// SPDX-License-Identifier: GPL-3.0-or-later
// A surface that can be looked at and asked for heights: tiles of `maquette lod` or a raster.
// Everything is in the model frame: mm, x east, y north, z up.

import * as THREE from 'three';
import { carries } from './carried';
import { GridGround } from './grid_ground';
import type { GroundMaterial } from './ground_material';
import { getGrid, getProfile, type Contents, type FieldEntry, type Triple } from './contents';
import { figure } from './palette';
import { RasterGround } from './raster_ground';
import { TiledGround } from './tiled_ground';

export interface Box { low: Triple; high: Triple }
export interface Hit { place: Triple; stone: number | null }
export interface Heights { values: (number | null)[]; exact: string }

export interface Surface {
  name: string;
  group: THREE.Object3D;
  note: string;
  box: Box;
  /** Loads what this camera needs. @return true while something is under way */
  update(camera: THREE.PerspectiveCamera, width: number, height: number): boolean;
  /** Where a ray (model frame without exaggeration) meets what is shown. */
  meet(ray: THREE.Raycaster, exaggeration: number): Hit | null;
  /** Full-resolution heights at even places on a line; one place: at `from`. Not there: it has no height. */
  heights?(from: number[], to: number[], count: number): Promise<Heights>;
  dispose(): void;
}

export interface SurfaceChoice { id: string; label: string; open(): Promise<Surface> }

const kNodes = 501; // a side of a raster that is shown at once: half a million triangles

class FieldSurface extends GridGround implements Surface {
  note: string;
  constructor(public name: string, private entry: FieldEntry, grid: Awaited<ReturnType<typeof getGrid>>, material: GroundMaterial) {
    super(grid, material);
    // Only an exported page has less than all here.
    const places = grid.whole ? 'Every node is shown' : `${grid.cols} × ${grid.rows} places of ${entry.nodes.join(' × ')} nodes are in this page`;
    this.note = `${places}.`;
    if (grid.loss) {
      const loss = `within ${figure(grid.loss.most_mm, 2)} mm of the file (rms ${figure(grid.loss.rms_mm, 2)} mm)`;
      this.note = `${places}, ${loss}.`;
      this.exact = `of what this page carries, ${loss}`;
    }
  }
  private exact = 'of the file';
  async heights(from: number[], to: number[], count: number): Promise<Heights> {
    return { values: await getProfile(this.entry.path, from, to, count), exact: this.exact };
  }
}

/** What a field without a surface lies on. */
class EvenGround extends GridGround implements Surface {
  readonly name = 'even ground';
  readonly note = 'No surface is in this folder: colours lie on even ground.';
}

function evenGround(entry: FieldEntry, material: GroundMaterial): EvenGround {
  const dx_mm = (entry.nodes[0] - 1) * entry.spacing_mm, dy_mm = (entry.nodes[1] - 1) * entry.spacing_mm;
  const [x0_mm, y0_mm] = entry.origin_mm;
  return new EvenGround({ rows: 2, cols: 2, x0_mm, y0_mm, dx_mm, dy_mm, whole: true, values: new Float32Array(4) }, material);
}

/** What a folder offers, the best first. */
export function choices(contents: Contents, material: GroundMaterial, told: (problem: string) => void,
  changed: () => void): SurfaceChoice[] {
  const list: SurfaceChoice[] = contents.tilesets.map((tileset) => ({
    id: tileset.path, label: tileset.path,
    open: () => TiledGround.open(tileset, material, told, changed),
  }));
  const rank = (name: string) => ['surface.tif', 'design.tif', 'as_milled.tif'].indexOf(name.split('/').pop()!) + 1 || 9;
  const heights = contents.fields.filter((f) => f.kind === 'height').sort((a, b) => rank(a.path) - rank(b.path));
  for (const entry of heights)
    list.push({ id: entry.path, label: entry.path,
      open: async () => (carries || Math.max(...entry.nodes) <= kNodes
        ? new FieldSurface(entry.path, entry, await getGrid(entry.path, kNodes, false), material)
        : RasterGround.open(entry, material, told, changed)) });
  const field = contents.fields[0];
  if (list.length === 0 && field)
    list.push({ id: 'even', label: 'even ground', open: async () => evenGround(field, material) });
  return list;
}
