// SPDX-License-Identifier: GPL-3.0-or-later
// A raster as triangles, cut from lower left to upper right as in every room.

import * as THREE from 'three';
import type { Grid } from './contents';
import { heightOn } from './height_on';
import type { GroundMaterial } from './ground_material';
import type { Box, Hit } from './surface';

export class GridGround {
  readonly group = new THREE.Group();
  readonly box: Box;
  private readonly geometry = new THREE.BufferGeometry();

  constructor(private readonly grid: Grid, material: GroundMaterial) {
    const { rows, cols, values } = grid;
    const position = new Float32Array(3 * values.length), normal = new Float32Array(3 * values.length);
    let low = Infinity, high = -Infinity;
    for (const z of values) if (!Number.isNaN(z)) { low = Math.min(low, z); high = Math.max(high, z); }
    const at = (r: number, c: number, otherwise: number) => {
      const z = r < 0 || c < 0 || r >= rows || c >= cols ? NaN : values[r * cols + c]!;
      return Number.isNaN(z) ? otherwise : z;
    };
    for (let r = 0; r < rows; r += 1)
      for (let c = 0; c < cols; c += 1) {
        const i = r * cols + c, z = at(r, c, low);
        position.set([grid.x0_mm + c * grid.dx_mm, grid.y0_mm + r * grid.dy_mm, z], 3 * i);
        const west = at(r, c - 1, NaN), east = at(r, c + 1, NaN), south = at(r - 1, c, NaN), north = at(r + 1, c, NaN);
        const slope = (before: number, after: number, step: number) => {
          const b = Number.isNaN(before), a = Number.isNaN(after);
          return b && a ? 0 : ((a ? z : after) - (b ? z : before)) / (step * (a || b ? 1 : 2));
        };
        const nx = -slope(west, east, grid.dx_mm), ny = -slope(south, north, grid.dy_mm), n = Math.hypot(nx, ny, 1);
        normal.set([nx / n, ny / n, 1 / n], 3 * i);
      }
    const index = new Uint32Array(6 * (rows - 1) * (cols - 1));
    let n = 0;
    for (let r = 0; r + 1 < rows; r += 1)
      for (let c = 0; c + 1 < cols; c += 1) {
        const a = r * cols + c, b = a + 1, e = a + cols, f = e + 1;
        const there = (...nodes: number[]) => nodes.every((k) => !Number.isNaN(values[k]!));
        if (there(a, b, f)) { index.set([a, b, f], n); n += 3; }
        if (there(a, f, e)) { index.set([a, f, e], n); n += 3; }
      }
    this.geometry.setAttribute('position', new THREE.BufferAttribute(position, 3));
    this.geometry.setAttribute('normal', new THREE.BufferAttribute(normal, 3));
    this.geometry.setIndex(new THREE.BufferAttribute(index.subarray(0, n), 1));
    this.group.add(new THREE.Mesh(this.geometry, material.smooth));
    this.box = { low: [grid.x0_mm, grid.y0_mm, low],
      high: [grid.x0_mm + (cols - 1) * grid.dx_mm, grid.y0_mm + (rows - 1) * grid.dy_mm, high] };
  }

  update(): boolean { return false; }

  /** Along the ray in steps of half a cell until it is below the ground, then by halves. */
  meet(ray: THREE.Raycaster, exaggeration: number): Hit | null {
    const g = this.grid, from = ray.ray.origin, along = ray.ray.direction;
    const above = (t: number) => {
      const x = (from.x + t * along.x - g.x0_mm) / g.dx_mm, y = (from.y + t * along.y - g.y0_mm) / g.dy_mm;
      return (from.z + t * along.z) / exaggeration - heightOn(g.values, g.cols, g.rows, x, y);
    };
    const box = new THREE.Box3(new THREE.Vector3(...this.box.low), new THREE.Vector3(...this.box.high));
    box.min.z = box.min.z * exaggeration - 1e-3;
    box.max.z = box.max.z * exaggeration + 1e-3;
    const start = ray.ray.intersectBox(box, new THREE.Vector3());
    if (!start) return null;
    const inside = box.containsPoint(from);
    let t = inside ? 0 : start.distanceTo(from);
    const end = t + box.getSize(new THREE.Vector3()).length();
    const level = Math.hypot(along.x, along.y), step = Math.min(0.5 * Math.min(g.dx_mm, g.dy_mm) / Math.max(level, 1e-3), end / 50);
    for (let before = above(t); t < end; t += step) {
      const after = above(t + step);
      if (before >= 0 && after < 0) {
        let a = t, b = t + step;
        for (let i = 0; i < 40; i += 1) { const m = 0.5 * (a + b); if (above(m) >= 0) a = m; else b = m; }
        return { place: [from.x + a * along.x, from.y + a * along.y, (from.z + a * along.z) / exaggeration], stone: null };
      }
      before = after;
    }
    return null;
  }

  dispose(): void { this.geometry.dispose(); }
}
