// SPDX-License-Identifier: GPL-3.0-or-later
// Cameras of scenes, trajectories and photographs: each as a pyramid where it stands, a line along
// each trajectory, the picture of one that is clicked, and the view from it with the picture over it.

import * as THREE from 'three';
import { pictureUrl, type FrameEntry } from './contents';
import { addOption, byId } from './elements';
import { figure } from './palette';
import type { Stage } from './stage';

const kMostPyramids = 60; // of a trajectory
const kNear = 7;          // pixels from a line that is clicked
const kLook = { scene: 0xff7a00, trajectory: 0x9b5de5, photo: 0x00a37a };

export class Frames {
  current = '';
  /** Whose picture is shown below. */
  pictured = '';
  private readonly shot = byId<HTMLImageElement>('shot');
  private readonly opacity = byId<HTMLInputElement>('shot-opacity');
  private readonly select = byId<HTMLSelectElement>('frame');
  private readonly panel = byId('photo');
  private readonly picture = byId<HTMLImageElement>('photo-picture');
  private readonly drawn = new THREE.Group();
  private readonly pyramids: { frame: FrameEntry; corners: THREE.Vector3[]; lines: THREE.LineSegments }[] = [];
  private readonly chosen = new THREE.LineSegments(new THREE.BufferGeometry(),
    new THREE.LineBasicMaterial({ color: 0xe6007a, depthTest: false }));

  constructor(private readonly frames: FrameEntry[], private readonly stage: Stage,
    private readonly changed: () => void, private readonly told: (problem: string) => void) {
    byId('cameras').hidden = frames.length === 0;
    for (const f of frames) addOption(this.select, f.name, f.name);
    this.draw();
    this.chosen.visible = false;
    this.chosen.renderOrder = 9;
    stage.scene.add(this.drawn, this.chosen);
    this.select.addEventListener('change', () => this.show(this.select.value));
    this.opacity.addEventListener('input', () => this.fit());
    byId('frame-photo').addEventListener('click', () => this.open(this.current || this.pictured || frames[0]!.name));
    byId('photo-look').addEventListener('click', () => this.show(this.pictured));
    byId('photo-close').addEventListener('click', () => { this.open(''); this.stage.canvas.focus(); });
    byId('photo-before').addEventListener('click', () => this.step(-1));
    byId('photo-next').addEventListener('click', () => this.step(1));
    this.picture.addEventListener('error', () => { if (this.pictured) this.told(`${this.pictured}: the picture cannot be shown`); });
    new ResizeObserver(() => this.fit()).observe(stage.canvas);
    // Whoever turns the view leaves the camera; a click does not.
    let held = false;
    stage.controls.addEventListener('start', () => { held = true; });
    stage.controls.addEventListener('end', () => { held = false; });
    stage.controls.addEventListener('change', () => { if (held && this.current) this.show('', true); });
    const photos = frames.filter((f) => f.kind === 'photo').length, rows = new Set(frames.filter((f) => f.kind === 'trajectory').map((f) => f.scene)).size;
    byId('frames-note').textContent = [photos ? `${photos} photograph${photos > 1 ? 's' : ''} (green)` : '',
      rows ? `${rows === 1 ? 'a trajectory' : `${rows} trajectories`} of ${frames.filter((f) => f.kind === 'trajectory').length} poses (violet)` : '']
      .filter(Boolean).join(', ').replace(/^./, (c) => c.toUpperCase()).concat(photos + rows ? '. ' : '')
      + 'A click on a camera shows its picture.';
  }

  private draw(): void {
    const lines = new Map<string, FrameEntry[]>();
    for (const f of this.frames) {
      if (f.kind === 'trajectory') lines.set(f.scene, [...lines.get(f.scene) ?? [], f]);
      else this.addPyramid(f);
    }
    for (const poses of lines.values()) {
      const way = new THREE.BufferGeometry().setFromPoints(poses.map((f) => new THREE.Vector3(...f.position_mm)));
      this.drawn.add(new THREE.Line(way, new THREE.LineBasicMaterial({ color: kLook.trajectory })));
      const step = Math.max(1, Math.ceil(poses.length / kMostPyramids));
      poses.forEach((f, i) => { if (i % step === 0 || i + 1 === poses.length) this.addPyramid(f, 0.12); });
    }
  }

  /** @param share  of the way to what it looks at */
  private corners(f: FrameEntry, share = 0.25): THREE.Vector3[] {
    const eye = new THREE.Vector3(...f.position_mm), target = new THREE.Vector3(...f.target_mm);
    const pose = new THREE.Matrix4().lookAt(eye, target, new THREE.Vector3(...f.up)).setPosition(eye);
    const far = share * eye.distanceTo(target);
    const w = 0.5 * far * f.across_mm / f.focal_mm, h = 0.5 * far * f.down_mm / f.focal_mm;
    return [eye, ...[[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => new THREE.Vector3(x! * w, y! * h, -far).applyMatrix4(pose))];
  }
  private static edges(c: THREE.Vector3[]): THREE.Vector3[] {
    return [1, 2, 3, 4].flatMap((i) => [c[0]!, c[i]!, c[i]!, c[i % 4 + 1]!]);
  }
  private addPyramid(f: FrameEntry, share?: number): void {
    const corners = this.corners(f, share);
    const lines = new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(Frames.edges(corners)),
      new THREE.LineBasicMaterial({ color: kLook[f.kind] }));
    this.drawn.add(lines);
    this.pyramids.push({ frame: f, corners, lines });
  }

  /** The camera whose lines are met at a place of the canvas, the nearest first. */
  at(x: number, y: number): string {
    if (!this.drawn.visible) return '';
    const [width, height] = this.stage.paneSize(), { camera } = this.stage;
    const u = x % width;
    let best = kNear, name = '';
    for (const { frame, corners } of this.pyramids) {
      const seen = corners.map((p) => { const v = p.clone().project(camera); return { x: 0.5 * (v.x + 1) * width, y: 0.5 * (1 - v.y) * height, z: v.z }; });
      if (seen.some((p) => p.z > 1 || p.z < -1)) continue;
      for (const [i, k] of [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]] as const) {
        const a = seen[i]!, b = seen[k]!, dx = b.x - a.x, dy = b.y - a.y;
        const t = Math.min(1, Math.max(0, ((u - a.x) * dx + (y - a.y) * dy) / Math.max(1e-9, dx * dx + dy * dy)));
        const d = Math.hypot(a.x + t * dx - u, a.y + t * dy - y);
        if (d < best) { best = d; name = frame.name; }
      }
    }
    return name;
  }

  private step(by: number): void {
    const at = this.frames.findIndex((f) => f.name === this.pictured), next = this.frames[at + by];
    if (!next) return;
    // Whoever looks from a camera goes on looking from them.
    if (this.current) this.show(next.name);
    this.open(next.name);
  }

  /** Shows a camera's picture below the view; empty: none. */
  open(name: string): void {
    const at = this.frames.findIndex((g) => g.name === name), f = this.frames[at];
    this.pictured = f?.name ?? '';
    this.panel.hidden = !f;
    this.chosen.visible = Boolean(f);
    if (f) {
      this.chosen.geometry.dispose();
      this.chosen.geometry = new THREE.BufferGeometry().setFromPoints(Frames.edges(
        this.pyramids.find((p) => p.frame === f)?.corners ?? this.corners(f, f.kind === 'trajectory' ? 0.12 : 0.25)));
      const way = Math.hypot(...f.position_mm.map((v, i) => v - f.target_mm[i]!));
      byId('photo-text').textContent = `${f.name}: from x, y, z ${f.position_mm.map((v) => v.toFixed(1)).join(', ')} mm, ${figure(way, 3)} mm away`
        + (f.time_s === undefined ? '' : `, at ${figure(f.time_s, 6)} s`) + (f.held_out ? '; held out of the diagnosis' : '')
        + (f.picture ? '.' : '. Its picture is not in this folder.');
      byId<HTMLButtonElement>('photo-before').disabled = at === 0;
      byId<HTMLButtonElement>('photo-next').disabled = at + 1 === this.frames.length;
      this.picture.hidden = !f.picture;
      this.picture.alt = `what ${f.name} shows`;
      this.fill(this.picture, f);
    }
    this.changed();
    this.stage.later();
  }

  private fill(image: HTMLImageElement, f: FrameEntry): void {
    if (!f.picture) { image.removeAttribute('src'); return; }
    pictureUrl(f).then((url) => { image.src = url; }).catch((error: Error) => this.told(error.message));
  }

  show(name: string, keepView = false): void {
    const f = this.frames.find((g) => g.name === name);
    this.current = f?.name ?? '';
    this.select.value = this.current;
    this.drawn.visible = !f;
    if (f) this.chosen.visible = false;
    this.stage.framed = Boolean(f);
    byId('frame-note').textContent = f && !f.picture ? 'Its picture is not in this folder.' : '';
    if (f && !keepView) {
      this.stage.exaggeration = 1;
      byId<HTMLInputElement>('exaggeration').value = '1';
      this.stage.lookAs(f.position_mm, f.target_mm, f.up);
      this.fill(this.shot, f);
    } else {
      this.stage.camera.fov = 40;
      this.stage.upright();
    }
    this.fit();
    this.stage.controls.update();
    this.stage.later();
  }

  /** The view as wide as the picture, the picture over it. */
  private fit(): void {
    const f = this.frames.find((g) => g.name === this.current);
    (this.opacity.nextElementSibling as HTMLOutputElement).value = this.opacity.value;
    this.shot.hidden = !f?.picture;
    if (!f) return;
    const [width, height] = this.stage.paneSize(), wide = f.across_mm / f.down_mm;
    const h = Math.min(height, width / wide), w = h * wide;
    this.stage.camera.fov = 360 / Math.PI * Math.atan(0.5 * f.down_mm / f.focal_mm * height / h);
    Object.assign(this.shot.style, { width: `${w}px`, height: `${h}px`, left: `${0.5 * (width - w)}px`,
      top: `${0.5 * (height - h)}px`, opacity: this.opacity.value });
    this.stage.later();
  }
}
