// SPDX-License-Identifier: GPL-3.0-or-later
// Camera, sun and one or two panes that look from the same place. The scene is in mm of the model,
// z up; heights are drawn times the exaggeration.

import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import type { Box, Hit, Surface } from './surface';
import type { Triple } from './contents';

const kTogether = 200; // ms; tiles that come within are drawn at once
// Where a picture takes longer than kSlow (no graphics processor, a remote desktop) coarser ground and
// stones are drawn while the view moves, by kLess of the pixels, and all of it when it rests. ms
const kSlow = 100, kRest = 250, kLess = 0.2;

export class Stage {
  readonly renderer: THREE.WebGLRenderer;
  readonly camera = new THREE.PerspectiveCamera(40, 1, 1, 10_000);
  private readonly chooser = new THREE.PerspectiveCamera();
  readonly controls: OrbitControls;
  readonly scene = new THREE.Scene();
  /** What is as high as the exaggeration says: surfaces, paths, marks. */
  readonly relief = new THREE.Group();
  /** The left pane's surface and, where there are two panes, the right one's. */
  panes: (Surface | null)[] = [null];
  /** A camera frame is looked through. */
  framed = false;
  before: () => void = () => {};
  /** Before a pane is drawn. */
  dress: (pane: number) => void = () => {};
  /** What is seen is not all that there is to see, or no longer. */
  stirs: () => void = () => {};
  still: () => void = () => {};
  shown: () => void = () => {};
  private readonly sun = new THREE.DirectionalLight(0xfff6ea, 3.4);
  private readonly marks = new THREE.Points(new THREE.BufferGeometry(),
    new THREE.PointsMaterial({ color: 0xff7a00, size: 11, sizeAttenuation: false, depthTest: false }));
  private stale = true;
  private fresh = false;
  private drawn = 0;
  private busy = false;
  /** Of the pixels along a side, for which levels are chosen. */
  private share = 1;
  private moved = -Infinity;
  /** All that there is to see is drawn, and the view has not moved for kRest. */
  private rests = false;
  private turn = { at: 0, drew: false };

  constructor(readonly canvas: HTMLCanvasElement, context: WebGL2RenderingContext) {
    this.renderer = new THREE.WebGLRenderer({ canvas, context });
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.camera.up.set(0, 0, 1);
    this.chooser.matrixAutoUpdate = this.chooser.matrixWorldAutoUpdate = false;
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.zoomToCursor = true;
    this.controls.maxPolarAngle = 0.999 * Math.PI / 2;
    this.controls.addEventListener('change', () => { this.moved = performance.now(); this.later(); });
    this.marks.frustumCulled = false;
    this.marks.renderOrder = 10;
    this.relief.add(this.marks);
    this.scene.add(this.relief, this.sun, this.sun.target, new THREE.AmbientLight(0xdfe8ff, 0.35));
    new ResizeObserver(() => this.later()).observe(canvas);
    window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.later());
    const turn = () => { requestAnimationFrame(turn); this.frame(); };
    requestAnimationFrame(turn);
  }

  later(): void { this.stale = true; this.stir(); }

  /** Something was loaded: drawn soon, with what else comes by then. */
  arrived(): void { this.fresh = true; this.stir(); }

  private stir(): void {
    this.rests = false;
    this.stirs();
  }

  get exaggeration(): number { return this.relief.scale.z; }
  set exaggeration(times: number) {
    // What is looked at stays in the middle.
    this.controls.target.z *= times / this.relief.scale.z;
    this.relief.scale.z = times;
    this.controls.update();
    this.later();
  }

  /** Degrees; 0 is north, 90 east. */
  setSun(azimuth: number, elevation: number): void {
    const a = azimuth * Math.PI / 180, e = elevation * Math.PI / 180;
    this.sun.position.set(Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), Math.sin(e));
    this.later();
  }

  setMarks(places: Triple[]): void {
    this.marks.geometry.dispose();
    this.marks.geometry = new THREE.BufferGeometry().setFromPoints(places.map((p) => new THREE.Vector3(...p)));
    this.marks.visible = places.length > 0;
    this.later();
  }

  look(box: Box, from: 'oblique' | 'above'): void {
    const middle = new THREE.Vector3(...box.low).add(new THREE.Vector3(...box.high)).multiplyScalar(0.5);
    const size = Math.hypot(box.high[0] - box.low[0], box.high[1] - box.low[1]);
    middle.z *= this.exaggeration;
    this.controls.target.copy(middle);
    // Two panes see as much as one does.
    const aspect = this.panes.length * this.paneSize()[0] / this.paneSize()[1];
    // The whole of it is seen: across the picture, or down.
    const far = size * (from === 'above' ? 1.02 : 1.2) * Math.max(1, 1.2 / aspect);
    // Not quite from above: there north would have no direction.
    this.camera.position.copy(middle).add(from === 'above' ? new THREE.Vector3(0, -1e-4 * far, far)
      : new THREE.Vector3(-0.25 * far, -0.8 * far, 0.6 * far));
    this.camera.fov = 40;
    this.controls.update();
    this.later();
  }

  /** As a camera sees it that may be turned about its axis. */
  lookAs(position: Triple, target: Triple, up: Triple): void {
    this.camera.position.set(...position);
    this.controls.target.set(...target);
    this.camera.up.set(...up);
    this.controls.update();
    this.later();
  }

  /** Up is up again; from straight above, what was up in the picture stays there. */
  upright(): void {
    const { camera, controls } = this, offset = camera.position.clone().sub(controls.target);
    const far = offset.length(), up = camera.up.clone().setZ(0);
    if (Math.hypot(offset.x, offset.y) < 1e-3 * far && up.length() > 0.1)
      camera.position.addScaledVector(up.normalize(), -1e-3 * far);
    camera.up.set(0, 0, 1);
  }

  /** Arrows turn, with shift they move; + and - come nearer. @return whether the key was one of them */
  key(event: KeyboardEvent): boolean {
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    const offset = this.camera.position.clone().sub(this.controls.target);
    if (arrow && event.shiftKey) {
      const right = new THREE.Vector3().setFromMatrixColumn(this.camera.matrix, 0);
      const ahead = new THREE.Vector3().crossVectors(this.camera.up, right);
      const way = right.multiplyScalar(arrow[0]!).addScaledVector(ahead, arrow[1]!).multiplyScalar(0.06 * offset.length());
      this.camera.position.add(way);
      this.controls.target.add(way);
    } else if (arrow) {
      const round = new THREE.Spherical().setFromVector3(new THREE.Vector3(offset.x, offset.z, -offset.y));
      round.theta += 0.08 * arrow[0]!;
      round.phi = Math.min(this.controls.maxPolarAngle, Math.max(1e-4, round.phi - 0.06 * arrow[1]!));
      const v = new THREE.Vector3().setFromSpherical(round);
      this.camera.position.copy(this.controls.target).add(new THREE.Vector3(v.x, -v.z, v.y));
    } else if (event.key === '+' || event.key === '=' || event.key === '-') {
      this.camera.position.copy(this.controls.target).addScaledVector(offset, event.key === '-' ? 1.15 : 1 / 1.15);
    } else {
      return false;
    }
    // As the mouse does it.
    this.controls.dispatchEvent({ type: 'start' });
    this.controls.update();
    this.controls.dispatchEvent({ type: 'end' });
    this.later();
    return true;
  }

  /** x, y in pixels of the canvas: the surface in that pane and where it is met. */
  async ask(x: number, y: number): Promise<{ surface: Surface; hit: Hit } | null> {
    const [width, height] = this.paneSize(), pane = Math.min(this.panes.length - 1, Math.floor(x / width));
    const surface = this.panes[pane];
    if (!surface) return null;
    this.place();
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(2 * (x - pane * width) / width - 1, 1 - 2 * y / height), this.camera);
    const hit = surface.meet(ray, this.exaggeration);
    return hit && { surface, hit };
  }

  picture(): Promise<Blob | null> {
    this.draw();
    return new Promise((resolve) => { this.canvas.toBlob(resolve, 'image/png'); });
  }

  paneSize(): [number, number] {
    return [Math.max(1, this.canvas.clientWidth / this.panes.length), Math.max(1, this.canvas.clientHeight)];
  }

  private place(): void {
    const [width, height] = this.paneSize();
    this.camera.aspect = width / height;
    // Two panes see as much as one, but not where a lens says how much that is.
    this.camera.zoom = this.framed ? 1 : 1 / this.panes.length;
    const far = this.camera.position.distanceTo(this.controls.target), box = this.panes.find((p) => p)?.box;
    const size = box ? Math.hypot(...box.high.map((h, i) => (h - box.low[i]!) * (i === 2 ? this.exaggeration : 1))) : far;
    this.camera.near = Math.max(far / 200, 0.02);
    this.camera.far = far + 3 * size;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    this.relief.updateMatrixWorld(true);
  }

  /** Levels are chosen where heights are not exaggerated, by a camera that sees the same there; the
   * surface is asked for pixels the finer. */
  private flatten(times: number): void {
    this.relief.scale.z = 1;
    this.relief.updateMatrixWorld(true);
    const { chooser, camera } = this;
    chooser.matrixWorld.makeScale(1, 1, 1 / times).multiply(camera.matrixWorld);
    chooser.matrixWorldInverse.copy(chooser.matrixWorld).invert();
    chooser.projectionMatrix.copy(camera.projectionMatrix);
    chooser.projectionMatrixInverse.copy(camera.projectionMatrixInverse);
  }

  private moves(): boolean { return performance.now() - this.moved < kRest; }

  private pace(): void {
    const now = performance.now(), moves = this.moves();
    const slow = this.turn.drew && now - this.turn.at > kSlow;
    const share = !moves ? 1 : slow ? kLess : this.share;
    this.turn = { at: now, drew: false };
    if (share !== this.share) this.later();
    this.share = share;
  }

  private frame(): void {
    this.before();
    this.pace();
    if (this.fresh && performance.now() - this.drawn > kTogether) this.stale = true;
    if (this.rests) return;
    this.place();
    const [width, height] = this.paneSize(), pixels = this.share * this.renderer.getPixelRatio(), wasBusy = this.busy;
    this.busy = false; // else it goes on asking while something loads
    const times = this.relief.scale.z;
    this.flatten(times);
    for (const pane of new Set(this.panes))
      if (pane?.update(this.chooser, width * pixels * times, height * pixels * times)) this.busy = true;
    this.relief.scale.z = times;
    this.relief.updateMatrixWorld(true);
    if (this.stale || (wasBusy && !this.busy)) {
      this.stale = this.fresh = false;
      this.draw();
      this.turn.drew = true;
      this.drawn = performance.now();
      this.shown();
    }
    this.rests = !this.busy && !this.fresh && !this.moves() && this.share === 1;
    if (this.rests && this.panes.some((p) => p)) this.still();
  }

  private draw(): void {
    const { canvas, renderer } = this, width = canvas.clientWidth, height = canvas.clientHeight;
    if (width === 0 || height === 0) return;
    const size = renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) renderer.setSize(width, height, false);
    this.place();
    renderer.setClearColor(getComputedStyle(canvas.parentElement!).backgroundColor);
    renderer.setScissorTest(this.panes.length > 1);
    this.panes.forEach((pane, i) => {
      const [w] = this.paneSize();
      renderer.setViewport(i * w, 0, w, height);
      renderer.setScissor(i * w, 0, w - (i + 1 < this.panes.length ? 2 : 0), height);
      for (const other of new Set(this.panes)) if (other) other.group.visible = other === pane;
      this.dress(i);
      renderer.render(this.scene, this.camera);
    });
    for (const pane of this.panes) if (pane) pane.group.visible = true;
  }
}
