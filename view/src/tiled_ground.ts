// SPDX-License-Identifier: GPL-3.0-or-later
// What `maquette lod` has written, streamed by 3d-tiles-renderer: with all tiles named in
// tileset.json, or as the implicit quadtree of tileset_implicit.json and its subtrees. Heights come
// from the finest tile at the place, whatever level is on the screen.

import * as THREE from 'three';
import { TilesRenderer } from '3d-tiles-renderer';
import { ImplicitTilingPlugin } from '3d-tiles-renderer/plugins';
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';
import dracoScript from 'three/addons/libs/draco/gltf/draco_wasm_wrapper.js?url';
import dracoBinary from 'three/addons/libs/draco/gltf/draco_decoder.wasm?url';
import { carriedUrl, carries } from './carried';
import { fileUrl, getFile, getJson, type TilesetEntry } from './contents';
import { heightOn } from './height_on';
import { stoneNumbers, type GroundMaterial } from './ground_material';
import { figure } from './palette';
import type { Box, Heights, Hit, Surface } from './surface';

interface Lod {
  nodes: [number, number]; spacing_mm: number; x0_mm: number; y0_mm: number; tile_quads: number;
  scale_denominator: number; metres_per_model_metre?: [number, number]; levels: { level: number; depth: number; max_vertical_error_mm: number }[];
}
/** Heights at the nodes of the field; of a coarser tile (an exported page may have no finer ones) its triangles. */
type FineTile = { cols: number; rows: number; values: Float32Array } | THREE.Object3D;
/** What the renderer keeps of a tile; its own types say less. */
interface Tile {
  geometricError: number; parent?: Tile | null; content?: { uri?: string };
  boundingVolume?: { box?: number[] }; transform?: number[]; children?: Tile[];
}

// Pixels of the measured error on the screen. Below one: what is seen of the ground is its slope.
const kErrorPixels = 0.35;
const kMostFineTiles = 64;

async function makeLoader(): Promise<GLTFLoader> {
  const [js, wasm] = carries ? await Promise.all([carriedUrl('page/draco_wasm_wrapper.js', 'text/javascript'),
    carriedUrl('page/draco_decoder.wasm', 'application/wasm')]) : [dracoScript, dracoBinary];
  const draco = new DRACOLoader().setDecoderPath({ js, wasm } as unknown as string);
  draco.setWorkerLimit(Math.max(1, Math.min(4, navigator.hardwareConcurrency - 1)));
  draco.preload();
  return new GLTFLoader().setDRACOLoader(draco).setMeshoptDecoder(MeshoptDecoder);
}
let theLoader: Promise<GLTFLoader> | null = null;
const loader = () => (theLoader ??= makeLoader());

/** Has the renderer find its tiles in the page. */
const kInPage = {
  name: 'IN_PAGE',
  fetchData: async (url: string) => {
    const folder = new URL('files/', document.baseURI).href;
    return new Response(await getFile(decodeURIComponent(new URL(url, document.baseURI).href.slice(folder.length))));
  },
};

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
    const lod = entry.lod ? await getJson<Lod>(entry.lod) : null;
    if (!lod) throw new Error(`${entry.path}: lod.json is not beside it; maquette lod writes both`);
    const root = (await getJson<{ root: Tile }>(entry.path)).root;
    return new TiledGround(entry, lod, root, await loader(), material, told, changed);
  }

  private constructor(entry: TilesetEntry, private readonly lod: Lod, root: Tile, gltf: GLTFLoader,
    material: GroundMaterial, told: (problem: string) => void, changed: () => void) {
    this.name = entry.path;
    this.folder = entry.path.slice(0, entry.path.lastIndexOf('/') + 1);
    const box = root.boundingVolume?.box ?? [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1];
    const width = (lod.nodes[0] - 1) * lod.spacing_mm, depth = (lod.nodes[1] - 1) * lod.spacing_mm;
    const [wide, high] = lod.metres_per_model_metre ?? [1, 1]; // across and upwards
    this.mm = [1000 / wide, 1000 / high];
    this.box = { low: [lod.x0_mm, lod.y0_mm, this.mm[1] * (box[2]! - Math.abs(box[11]!))],
      high: [lod.x0_mm + width, lod.y0_mm + depth, this.mm[1] * (box[2]! + Math.abs(box[11]!))] };
    const finest = lod.levels[0]!;
    const left = finest.level > 0 ? `; the ${finest.level} finest are not in this page` : '';
    const off = finest.max_vertical_error_mm;
    this.within = off < 0.1 ? `within ${(1000 * off).toPrecision(2)} µm of the design` : `within ${figure(off, 2)} mm of the design`;
    this.note = `${lod.levels.length} levels of ${lod.nodes.join(' × ')} nodes${left}; heights are of the finest`
      + `${left ? ' there' : ''}, ${this.within}.`;

    this.tiles = new TilesRenderer(fileUrl(entry.path));
    this.tiles.errorTarget = kErrorPixels;
    this.tiles.registerPlugin(new ImplicitTilingPlugin());
    if (carries) this.tiles.registerPlugin(kInPage);
    this.tiles.manager.addHandler(/\.(gltf|glb)$/, gltf);
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
    const tiles = this.tiles.group, [across, up] = this.mm;
    const model = new THREE.Matrix4().makeTranslation(lod.x0_mm, lod.y0_mm, 0).scale(new THREE.Vector3(across, across, across));
    if (root.transform) {
      model.multiply(new THREE.Matrix4().fromArray(root.transform).invert());
      this.note += ' It lies on the body; here it is shown as the model.';
    }
    tiles.matrixAutoUpdate = false;
    tiles.matrix.copy(model);
    this.group.add(tiles);
    this.group.scale.z = up / across; // of heights at full size: what makes them the model's again
  }
  private readonly folder: string;
  private readonly mm: [number, number]; // of the model for a metre of the content, across and upwards
  private readonly within: string;

  /** The camera as it stands before heights that an exaggeration has been taken out of; the renderer
      wants one scale in all directions (as does stage.ts). */
  private flattened(camera: THREE.PerspectiveCamera, times: number): THREE.Camera {
    const c = this.chooser;
    c.matrixWorld.makeScale(1, 1, 1 / times).multiply(camera.matrixWorld);
    c.matrixWorldInverse.copy(c.matrixWorld).invert();
    c.projectionMatrix.copy(camera.projectionMatrix);
    c.projectionMatrixInverse.copy(camera.projectionMatrixInverse);
    return c;
  }
  private readonly chooser = new THREE.PerspectiveCamera();

  update(seen: THREE.PerspectiveCamera, width: number, height: number): boolean {
    const times = this.group.scale.z, camera = times === 1 ? seen : this.flattened(seen, times);
    if (times !== 1) this.stretch(1);
    if (this.camera !== camera) {
      if (this.camera) this.tiles.deleteCamera(this.camera);
      this.tiles.setCamera(camera);
      this.camera = camera;
    }
    this.tiles.setResolution(camera, width * times, height * times);
    this.tiles.update();
    if (times !== 1) this.stretch(times);
    const s = (this.tiles as unknown as { stats: Record<string, number> }).stats;
    const loading = (s.downloading ?? 0) + (s.parsing ?? 0) + (s.queued ?? 0) > 0;
    const shown = this.tiles.visibleTiles.size > 0 || (s.failed ?? 0) > 0;
    this.busy = loading || !shown;
    return this.busy;
  }

  private stretch(times: number): void {
    this.group.scale.z = times;
    this.group.updateMatrixWorld(true);
  }

  meet(ray: THREE.Raycaster, exaggeration: number): Hit | null {
    const hit = ray.intersectObject(this.tiles.group, true)[0];
    if (!hit) return null;
    const numbers = stoneNumbers(hit.object), merged = (hit.object as THREE.Mesh).geometry.getAttribute('_feature_id_0');
    const which = hit.instanceId ?? (merged && hit.face ? merged.getX(hit.face.a) : 0);
    return { place: [hit.point.x, hit.point.y, hit.point.z / exaggeration],
      stone: numbers ? numbers[which] ?? null : null };
  }

  async heights(from: number[], to: number[], count: number): Promise<Heights> {
    const { lod } = this, values: (number | null)[] = [];
    for (let i = 0; i < count; i += 1) {
      const t = count < 2 ? 0 : i / (count - 1);
      const x = (from[0]! + t * (to[0]! - from[0]!) - lod.x0_mm) / lod.spacing_mm;
      const y = (from[1]! + t * (to[1]! - from[1]!) - lod.y0_mm) / lod.spacing_mm;
      values.push(await this.fineHeight(x, y));
    }
    return { values, exact: `of the finest tiles${this.lod.levels[0]!.level > 0 ? ` in this page, ${this.within}` : ''}` };
  }

  /** x, y in nodes. */
  private async fineHeight(x: number, y: number): Promise<number | null> {
    const { nodes, tile_quads: q, levels } = this.lod;
    if (!(x >= 0 && y >= 0 && x <= nodes[0] - 1 && y <= nodes[1] - 1)) return null;
    const finest = levels[0]!, wide = q * 2 ** finest.level;
    const column = Math.floor(Math.min(x, nodes[0] - 1.5) / wide), row = Math.floor(Math.min(y, nodes[1] - 1.5) / wide);
    const path = `${this.folder}tiles/${finest.depth}/${column}/${row}.glb`;
    let tile = this.fine.get(path);
    if (!tile) {
      tile = finest.level > 0 ? this.readTriangles(path) : this.readFine(path, column * q, row * q);
      this.fine.set(path, tile);
      if (this.fine.size > kMostFineTiles) this.fine.delete(this.fine.keys().next().value!);
    }
    const there = await tile.catch((error: Error) => {
      this.fine.delete(path);
      throw new Error(`${path}: ${error.message}`);
    });
    if (there instanceof THREE.Object3D) {
      const [across, up] = this.mm, down = new THREE.Vector3(0, -1, 0), far = 1e6 / up; // a km of the model
      const from = new THREE.Vector3(x * this.lod.spacing_mm / across, far, -y * this.lod.spacing_mm / across);
      const hit = new THREE.Raycaster(from, down).intersectObject(there, true)[0];
      return hit ? up * hit.point.y : null;
    }
    const z = heightOn(there.values, there.cols, there.rows, x - column * q, y - row * q);
    return Number.isNaN(z) ? null : z;
  }

  private async scene(path: string): Promise<THREE.Object3D> {
    const { scene } = await (await loader()).parseAsync(await getFile(path), '');
    scene.updateMatrixWorld(true);
    return scene;
  }

  private async readTriangles(path: string): Promise<THREE.Object3D> {
    const scene = await this.scene(path);
    scene.traverse((o) => { if (o instanceof THREE.Mesh) (o.material as THREE.Material).side = THREE.DoubleSide; });
    return scene;
  }

  /** A tile's vertices by the nodes of the field that they are. */
  private async readFine(path: string, column: number, row: number): Promise<FineTile> {
    const { lod } = this, q = lod.tile_quads;
    const cols = Math.min(q, lod.nodes[0] - 1 - column) + 1, rows = Math.min(q, lod.nodes[1] - 1 - row) + 1;
    const values = new Float32Array(cols * rows).fill(NaN);
    const scene = await this.scene(path);
    const place = new THREE.Vector3(), [across, up] = this.mm;
    scene.traverse((o) => {
      if (!(o instanceof THREE.Mesh)) return;
      const at = o.geometry.getAttribute('position');
      for (let i = 0; i < at.count; i += 1) {
        place.fromBufferAttribute(at, i).applyMatrix4(o.matrixWorld); // m, y up, north is -z
        const c = Math.round(across * place.x / lod.spacing_mm) - column, r = Math.round(-across * place.z / lod.spacing_mm) - row;
        if (c >= 0 && r >= 0 && c < cols && r < rows) values[r * cols + c] = up * place.y;
      }
      o.geometry.dispose();
    });
    return { cols, rows, values };
  }

  dispose(): void { this.tiles.dispose(); }
}
