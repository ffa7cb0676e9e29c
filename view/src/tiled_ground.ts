// SPDX-License-Identifier: GPL-3.0-or-later
// What `maquette lod` has written, streamed by 3d-tiles-renderer. Heights come from the finest tile
// at the place, whatever level is on the screen.

import * as THREE from 'three';
import { TilesRenderer } from '3d-tiles-renderer';
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';
import dracoScript from 'three/addons/libs/draco/gltf/draco_wasm_wrapper.js?url';
import dracoBinary from 'three/addons/libs/draco/gltf/draco_decoder.wasm?url';
import { fileUrl, getJson, type TilesetEntry } from './contents';
import { heightOn } from './grid_ground';
import { stoneNumbers, type GroundMaterial } from './ground_material';
import type { Box, Heights, Hit, Surface } from './surface';

interface Lod {
  nodes: [number, number]; spacing_mm: number; x0_mm: number; y0_mm: number; tile_quads: number;
  scale_denominator: number; levels: { depth: number; max_vertical_error_mm: number }[];
}
interface FineTile { cols: number; rows: number; values: Float32Array }
/** What the renderer keeps of a tile; its own types say less. */
interface Tile {
  geometricError: number; parent?: Tile | null; content?: { uri?: string };
  boundingVolume?: { box?: number[] }; transform?: number[]; children?: Tile[];
}

// Pixels of the measured error on the screen. Below one: what is seen of the ground is its slope.
const kErrorPixels = 0.35;
const kMostFineTiles = 64;

function makeLoader(): GLTFLoader {
  const draco = new DRACOLoader().setDecoderPath({ js: dracoScript, wasm: dracoBinary } as unknown as string);
  draco.setWorkerLimit(Math.max(1, Math.min(4, navigator.hardwareConcurrency - 1)));
  draco.preload();
  return new GLTFLoader().setDRACOLoader(draco).setMeshoptDecoder(MeshoptDecoder);
}
let theLoader: GLTFLoader | null = null;
const loader = () => (theLoader ??= makeLoader());

export class TiledGround implements Surface {
  readonly group = new THREE.Group();
  readonly name: string;
  note = '';
  box: Box;
  private readonly tiles: TilesRenderer;
  private readonly fine = new Map<string, Promise<FineTile>>();
  private camera: THREE.Camera | null = null;
  private busy = true;

  static async open(entry: TilesetEntry, material: GroundMaterial, told: (problem: string) => void,
    changed: () => void): Promise<TiledGround> {
    const lod = entry.lod ? await getJson<Lod>(fileUrl(entry.lod)) : null;
    if (!lod) throw new Error(`${entry.path}: lod.json is not beside it; maquette lod writes both`);
    const root = (await getJson<{ root: Tile }>(fileUrl(entry.path))).root;
    return new TiledGround(entry, lod, root, material, told, changed);
  }

  private constructor(entry: TilesetEntry, private readonly lod: Lod, root: Tile, material: GroundMaterial,
    told: (problem: string) => void, changed: () => void) {
    this.name = entry.path;
    this.folder = entry.path.slice(0, entry.path.length - 'tileset.json'.length);
    const box = root.boundingVolume?.box ?? [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1];
    const width = (lod.nodes[0] - 1) * lod.spacing_mm, depth = (lod.nodes[1] - 1) * lod.spacing_mm;
    this.box = { low: [lod.x0_mm, lod.y0_mm, 1000 * (box[2]! - Math.abs(box[11]!))],
      high: [lod.x0_mm + width, lod.y0_mm + depth, 1000 * (box[2]! + Math.abs(box[11]!))] };
    const finest = lod.levels[0]!;
    this.note = `${lod.levels.length} levels of ${lod.nodes.join(' × ')} nodes; heights are of the finest, within `
      + `${(1000 * finest.max_vertical_error_mm).toPrecision(2)} µm of the design.`;

    this.tiles = new TilesRenderer(fileUrl(entry.path));
    this.tiles.errorTarget = kErrorPixels;
    this.tiles.manager.addHandler(/\.(gltf|glb)$/, loader());
    const events = this.tiles as unknown as { addEventListener(name: string, f: (event: never) => void): void };
    events.addEventListener('load-model', ({ scene }: { scene: THREE.Object3D }) => { material.dress(scene); changed(); });
    events.addEventListener('needs-update', changed);
    events.addEventListener('tile-visibility-change', changed);
    events.addEventListener('load-error', ({ tile, error, url }: { tile: Tile | null; error: Error; url: string }) => {
      const parent = tile?.parent;
      // Ground that is one level coarser is better than a hole.
      const coarser = Boolean(parent?.content?.uri);
      if (parent && coarser) parent.geometricError = 0;
      const what = tile?.content?.uri ? this.folder + tile.content.uri : decodeURIComponent(String(url));
      told(`${what} cannot be shown (${error.message})${coarser ? '; coarser ground stands for it' : ''}. `
        + 'Make it again with maquette lod.');
      changed();
    });
    // Metres at the south-western node to mm of the model; a tileset on a body's ellipsoid is taken back.
    const tiles = this.tiles.group;
    const model = new THREE.Matrix4().makeTranslation(lod.x0_mm, lod.y0_mm, 0).scale(new THREE.Vector3(1000, 1000, 1000));
    if (root.transform) {
      model.multiply(new THREE.Matrix4().fromArray(root.transform).invert());
      this.note += ' It lies on the body; here it is shown as the model.';
    }
    tiles.matrixAutoUpdate = false;
    tiles.matrix.copy(model);
    this.group.add(tiles);
  }
  private readonly folder: string;

  update(camera: THREE.PerspectiveCamera, width: number, height: number): boolean {
    if (this.camera !== camera) {
      if (this.camera) this.tiles.deleteCamera(this.camera);
      this.tiles.setCamera(camera);
      this.camera = camera;
    }
    this.tiles.setResolution(camera, width, height);
    this.tiles.update();
    const s = (this.tiles as unknown as { stats: Record<string, number> }).stats;
    const loading = (s.downloading ?? 0) + (s.parsing ?? 0) + (s.queued ?? 0) > 0;
    const shown = this.tiles.visibleTiles.size > 0 || (s.failed ?? 0) > 0;
    this.busy = loading || !shown;
    return this.busy;
  }

  meet(ray: THREE.Raycaster, exaggeration: number): Hit | null {
    const hit = ray.intersectObject(this.tiles.group, true)[0];
    if (!hit) return null;
    const numbers = stoneNumbers(hit.object);
    return { place: [hit.point.x, hit.point.y, hit.point.z / exaggeration],
      stone: numbers ? numbers[hit.instanceId ?? 0] ?? null : null };
  }

  async heights(from: number[], to: number[], count: number): Promise<Heights> {
    const { lod } = this, values: (number | null)[] = [];
    for (let i = 0; i < count; i += 1) {
      const t = count < 2 ? 0 : i / (count - 1);
      const x = (from[0]! + t * (to[0]! - from[0]!) - lod.x0_mm) / lod.spacing_mm;
      const y = (from[1]! + t * (to[1]! - from[1]!) - lod.y0_mm) / lod.spacing_mm;
      values.push(await this.fineHeight(x, y));
    }
    return { values, exact: 'of the finest tiles' };
  }

  /** x, y in nodes. */
  private async fineHeight(x: number, y: number): Promise<number | null> {
    const { nodes, tile_quads: q, levels } = this.lod;
    if (!(x >= 0 && y >= 0 && x <= nodes[0] - 1 && y <= nodes[1] - 1)) return null;
    const column = Math.floor(Math.min(x, nodes[0] - 1.5) / q), row = Math.floor(Math.min(y, nodes[1] - 1.5) / q);
    const path = `${this.folder}tiles/${levels[0]!.depth}/${column}/${row}.glb`;
    let tile = this.fine.get(path);
    if (!tile) {
      tile = this.readFine(path, column * q, row * q);
      this.fine.set(path, tile);
      if (this.fine.size > kMostFineTiles) this.fine.delete(this.fine.keys().next().value!);
    }
    const { cols, rows, values } = await tile.catch((error: Error) => {
      this.fine.delete(path);
      throw new Error(`${path}: ${error.message}`);
    });
    const z = heightOn(values, cols, rows, x - column * q, y - row * q);
    return Number.isNaN(z) ? null : z;
  }

  /** A tile's vertices by the nodes of the field that they are. */
  private async readFine(path: string, column: number, row: number): Promise<FineTile> {
    const { lod } = this, q = lod.tile_quads;
    const cols = Math.min(q, lod.nodes[0] - 1 - column) + 1, rows = Math.min(q, lod.nodes[1] - 1 - row) + 1;
    const values = new Float32Array(cols * rows).fill(NaN);
    const { scene } = await loader().loadAsync(fileUrl(path));
    scene.updateMatrixWorld(true);
    const place = new THREE.Vector3();
    scene.traverse((o) => {
      if (!(o instanceof THREE.Mesh)) return;
      const at = o.geometry.getAttribute('position');
      for (let i = 0; i < at.count; i += 1) {
        place.fromBufferAttribute(at, i).applyMatrix4(o.matrixWorld); // m, y up, north is -z
        const c = Math.round(1000 * place.x / lod.spacing_mm) - column, r = Math.round(-1000 * place.z / lod.spacing_mm) - row;
        if (c >= 0 && r >= 0 && c < cols && r < rows) values[r * cols + c] = 1000 * place.y;
      }
      o.geometry.dispose();
    });
    return { cols, rows, values };
  }

  dispose(): void { this.tiles.dispose(); }
}
