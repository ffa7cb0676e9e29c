// SPDX-License-Identifier: GPL-3.0-or-later
// A raster that has more nodes than a screen shows: squares of every node, every second, fourth...,
// asked for as they come near. A square is divided where two of its nodes are farther apart than
// kPixels. Squares hang down at their inner sides, so that none shines through between two levels.

import * as THREE from 'three';
import { getProfile, getTile, type FieldEntry } from './contents';
import type { GroundMaterial } from './ground_material';
import type { Box, Heights, Hit, Surface } from './surface';

const kQuads = 128, kPixels = 2, kMostAtOnce = 6, kMostKept = 400;

interface Square {
  row: number; col: number; every: number;
  mesh: THREE.Mesh | null; surfaceIndices: number; low: number; high: number;
  children: Square[] | null; loading: boolean; failed: boolean; seen: number;
}

export class RasterGround implements Surface {
  readonly group = new THREE.Group();
  readonly name: string;
  readonly note: string;
  box: Box;
  private readonly roots: Square[] = [];
  private shown: Square[] = [];
  private wanted: Square[] = []; // the most urgent first
  private loading = 0;
  private kept = 0;
  private round = 0;

  /** @return with its coarsest squares loaded */
  static async open(entry: FieldEntry, material: GroundMaterial, told: (problem: string) => void, changed: () => void): Promise<RasterGround> {
    const ground = new RasterGround(entry, material, told, changed);
    await Promise.all(ground.roots.map((s) => ground.load(s)));
    const there = ground.roots.filter((s) => s.mesh);
    if (there.length === 0) throw new Error('no height could be read');
    ground.box.low[2] = Math.min(...there.map((s) => s.low));
    ground.box.high[2] = Math.max(...there.map((s) => s.high));
    return ground;
  }

  private constructor(private readonly entry: FieldEntry, private readonly material: GroundMaterial,
    private readonly told: (problem: string) => void, private readonly changed: () => void) {
    const [cols, rows] = entry.nodes, [x0, y0] = entry.origin_mm, s = entry.spacing_mm;
    this.name = entry.path;
    this.note = `Of ${cols} × ${rows} nodes those are shown that the screen has room for: nearer than ${kPixels} pixels to each other none is left out.`;
    this.box = { low: [x0, y0, 0], high: [x0 + (cols - 1) * s, y0 + (rows - 1) * s, 0] };
    let every = 1;
    while (kQuads * every < Math.max(cols, rows) - 1) every *= 2;
    every = Math.max(1, every / 4); // a first picture of up to 4 x 4 squares
    for (let row = 0; row < rows - 1; row += kQuads * every)
      for (let col = 0; col < cols - 1; col += kQuads * every) this.roots.push(this.square(row, col, every));
  }

  private square(row: number, col: number, every: number, parent?: Square): Square {
    return { row, col, every, mesh: null, surfaceIndices: 0, low: parent?.low ?? 0, high: parent?.high ?? 0,
      children: null, loading: false, failed: false, seen: 0 };
  }

  private async load(s: Square): Promise<void> {
    s.loading = true;
    this.loading += 1;
    try {
      this.build(s, await getTile(this.entry.path, s.row, s.col, s.every, kQuads));
      this.kept += 1;
    } catch (error) {
      s.failed = true;
      this.told(`${this.entry.path}: a part cannot be shown (${(error as Error).message}); coarser ground stands for it.`);
    } finally {
      s.loading = false;
      this.loading -= 1;
      this.changed();
    }
  }

  private build(s: Square, z: Float32Array): void {
    const { nodes, origin_mm: [x0, y0], spacing_mm: d } = this.entry, ring = kQuads + 3;
    const line = (first: number, count: number) => Array.from({ length: Math.min(kQuads, Math.ceil((count - 1 - first) / s.every)) + 1 },
      (_, i) => Math.min(first + i * s.every, count - 1));
    const across = line(s.col, nodes[0]), up = line(s.row, nodes[1]), cols = across.length, rows = up.length;
    const at = (r: number, c: number) => z[(r + 1) * ring + c + 1]!;
    let low = Infinity, high = -Infinity;
    for (let r = 0; r < rows; r += 1)
      for (let c = 0; c < cols; c += 1) { const v = at(r, c); if (!Number.isNaN(v)) { low = Math.min(low, v); high = Math.max(high, v); } }
    if (low > high) low = high = 0; // all void
    const n = rows * cols, position = new Float32Array(3 * (n + 2 * (rows + cols))), normal = new Float32Array(position.length);
    const step = s.every * d;
    for (let r = 0; r < rows; r += 1)
      for (let c = 0; c < cols; c += 1) {
        const i = 3 * (r * cols + c), v = at(r, c), here = Number.isNaN(v) ? low : v;
        position.set([x0 + across[c]! * d, y0 + up[r]! * d, here], i);
        const slope = (before: number, after: number) => {
          const b = Number.isNaN(before), a = Number.isNaN(after);
          return b && a ? 0 : ((a ? here : after) - (b ? here : before)) / (step * (a || b ? 1 : 2));
        };
        const nx = -slope(at(r, c - 1), at(r, c + 1)), ny = -slope(at(r - 1, c), at(r + 1, c)), length = Math.hypot(nx, ny, 1);
        normal.set([nx / length, ny / length, 1 / length], i);
      }
    const index = new Uint32Array(6 * (rows + 1) * (cols + 1));
    let m = 0;
    const push = (...list: number[]) => { for (const k of list) { index[m] = k; m += 1; } };
    const there = (...list: number[]) => list.every((k) => !Number.isNaN(at(Math.floor(k / cols), k % cols)));
    for (let r = 0; r + 1 < rows; r += 1)
      for (let c = 0; c + 1 < cols; c += 1) {
        const a = r * cols + c, b = a + 1, e = a + cols, f = e + 1;
        if (there(a, b, f)) push(a, b, f);
        if (there(a, f, e)) push(a, f, e);
      }
    s.surfaceIndices = m;
    // Hems: as deep as the square is high, at sides behind which the site goes on.
    const deep = high - low + step;
    let next = n;
    const hem = (edge: number[]) => {
      edge.forEach((k, i) => {
        position.set([position[3 * k]!, position[3 * k + 1]!, position[3 * k + 2]! - deep], 3 * (next + i));
        normal.set(normal.subarray(3 * k, 3 * k + 3), 3 * (next + i));
        if (i > 0 && there(k, edge[i - 1]!)) push(edge[i - 1]!, k, next + i, edge[i - 1]!, next + i, next + i - 1);
      });
      next += edge.length;
    };
    const row = (r: number) => across.map((_, c) => r * cols + c), column = (c: number) => up.map((_, r) => r * cols + c);
    if (s.row > 0) hem(row(0));
    if (up[rows - 1]! < nodes[1] - 1) hem(row(rows - 1));
    if (s.col > 0) hem(column(0));
    if (across[cols - 1]! < nodes[0] - 1) hem(column(cols - 1));
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(position.subarray(0, 3 * next), 3));
    geometry.setAttribute('normal', new THREE.BufferAttribute(normal.subarray(0, 3 * next), 3));
    geometry.setIndex(new THREE.BufferAttribute(index.slice(0, m), 1));
    geometry.boundingBox = new THREE.Box3(new THREE.Vector3(position[0]!, position[1]!, low - deep),
      new THREE.Vector3(position[3 * (n - 1)]!, position[3 * (n - 1) + 1]!, high));
    geometry.boundingSphere = geometry.boundingBox.getBoundingSphere(new THREE.Sphere());
    s.low = low;
    s.high = high;
    s.mesh = new THREE.Mesh(geometry, this.material.smooth);
    s.mesh.visible = false;
    this.group.add(s.mesh);
  }

  private boxOf(s: Square): THREE.Box3 {
    const { nodes, origin_mm: [x0, y0], spacing_mm: d } = this.entry, end = (first: number, count: number) => Math.min(first + kQuads * s.every, count - 1);
    return new THREE.Box3(new THREE.Vector3(x0 + s.col * d, y0 + s.row * d, s.low),
      new THREE.Vector3(x0 + end(s.col, nodes[0]) * d, y0 + end(s.row, nodes[1]) * d, s.high));
  }

  private childrenOf(s: Square): Square[] {
    const half = kQuads * s.every / 2, [cols, rows] = this.entry.nodes;
    return s.children ??= [[0, 0], [0, half], [half, 0], [half, half]]
      .filter(([r, c]) => s.row + r! < rows - 1 && s.col + c! < cols - 1)
      .map(([r, c]) => this.square(s.row + r!, s.col + c!, s.every / 2, s));
  }

  update(camera: THREE.PerspectiveCamera, _width: number, height: number): boolean {
    this.round += 1;
    const frustum = new THREE.Frustum().setFromProjectionMatrix(
      new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    const eye = new THREE.Vector3().setFromMatrixPosition(camera.matrixWorld);
    const scale = 0.5 * height * camera.projectionMatrix.elements[5]!; // pixels of a mm at a distance of one
    const shown: Square[] = [], wanted: { square: Square; pixels: number }[] = [];
    const seen = (s: Square) => frustum.intersectsBox(this.boxOf(s));
    const visit = (s: Square): void => {
      s.seen = this.round;
      const box = this.boxOf(s);
      const pixels = s.every * this.entry.spacing_mm * scale / Math.max(1e-6, box.distanceToPoint(eye));
      if (s.every > 1 && pixels > kPixels) {
        const children = this.childrenOf(s).filter(seen), missing = children.filter((c) => !c.mesh);
        for (const c of children) c.seen = this.round;
        for (const c of missing) if (!c.loading && !c.failed) wanted.push({ square: c, pixels });
        if (missing.length === 0) { children.forEach(visit); return; }
      }
      if (s.mesh) shown.push(s);
    };
    this.roots.filter(seen).forEach(visit);
    for (const s of this.shown) s.mesh!.visible = false;
    for (const s of shown) s.mesh!.visible = true;
    this.shown = shown;
    wanted.sort((a, b) => b.pixels - a.pixels);
    this.wanted = wanted.map((w) => w.square);
    this.loadNext();
    if (this.kept > kMostKept) for (const s of this.roots) this.forget(s);
    return this.loading > 0;
  }

  private loadNext(): void {
    while (this.loading < kMostAtOnce && this.wanted.length > 0) void this.load(this.wanted.shift()!).then(() => this.loadNext());
  }

  /** Squares that were not looked at lately. */
  private forget(s: Square): void {
    if (!s.children) return;
    if (s.children.every((c) => c.seen < this.round - 1 && !c.loading && !c.children)) {
      for (const c of s.children) if (c.mesh) { c.mesh.geometry.dispose(); c.mesh.removeFromParent(); this.kept -= 1; }
      s.children = null;
    } else {
      s.children.forEach((c) => this.forget(c));
    }
  }

  meet(ray: THREE.Raycaster, exaggeration: number): Hit | null {
    for (const s of this.shown) s.mesh!.updateMatrixWorld();
    const hit = ray.intersectObjects(this.shown.map((s) => s.mesh!), false)
      .find((h) => 3 * h.faceIndex! < this.shown.find((s) => s.mesh === h.object)!.surfaceIndices);
    return hit ? { place: [hit.point.x, hit.point.y, hit.point.z / exaggeration], stone: null } : null;
  }

  async heights(from: number[], to: number[], count: number): Promise<Heights> {
    return { values: await getProfile(this.entry.path, from, to, count), exact: 'of the file' };
  }

  dispose(): void {
    for (const o of this.group.children) (o as THREE.Mesh).geometry.dispose();
  }
}
