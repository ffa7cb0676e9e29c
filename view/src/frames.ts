// SPDX-License-Identifier: GPL-3.0-or-later
// Cameras of scene files: each as a pyramid where it stands, and the view from it with the rendered
// picture over it.

import * as THREE from 'three';
import { pictureUrl, type FrameEntry } from './contents';
import { addOption, byId } from './elements';
import type { Stage } from './stage';

export class Frames {
  current = '';
  private readonly shot = byId<HTMLImageElement>('shot');
  private readonly opacity = byId<HTMLInputElement>('shot-opacity');
  private readonly pyramids = new THREE.Group();

  constructor(private readonly frames: FrameEntry[], private readonly stage: Stage,
    private readonly told: (problem: string) => void) {
    byId('cameras').hidden = frames.length === 0;
    const select = byId<HTMLSelectElement>('frame');
    for (const f of frames) {
      addOption(select, f.scene, f.scene);
      this.pyramids.add(this.pyramid(f));
    }
    stage.scene.add(this.pyramids);
    select.addEventListener('change', () => this.show(select.value));
    this.opacity.addEventListener('input', () => this.fit());
    new ResizeObserver(() => this.fit()).observe(stage.canvas);
    // Whoever turns the view leaves the camera.
    stage.controls.addEventListener('start', () => { if (this.current) this.show('', true); });
  }

  private pyramid(f: FrameEntry): THREE.LineSegments {
    const pose = new THREE.Matrix4().lookAt(new THREE.Vector3(...f.position_mm), new THREE.Vector3(...f.target_mm), new THREE.Vector3(...f.up))
      .setPosition(...f.position_mm);
    const far = 0.25 * new THREE.Vector3(...f.position_mm).distanceTo(new THREE.Vector3(...f.target_mm));
    const w = 0.5 * far * f.across_mm / f.focal_mm, h = 0.5 * far * f.down_mm / f.focal_mm;
    const corner = (x: number, y: number) => new THREE.Vector3(x * w, y * h, -far).applyMatrix4(pose);
    const eye = new THREE.Vector3(...f.position_mm), c = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
    const points = c.flatMap((p, i) => [eye, p, p, c[(i + 1) % 4]!]);
    return new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), new THREE.LineBasicMaterial({ color: 0xff7a00 }));
  }

  show(scene: string, keepView = false): void {
    const f = this.frames.find((g) => g.scene === scene);
    this.current = f?.scene ?? '';
    byId<HTMLSelectElement>('frame').value = this.current;
    this.pyramids.visible = !f;
    this.stage.framed = Boolean(f);
    byId('frame-note').textContent = '';
    if (f && !keepView) {
      const { camera, controls } = this.stage;
      this.stage.exaggeration = 1;
      byId<HTMLInputElement>('exaggeration').value = '1';
      camera.position.set(...f.position_mm);
      controls.target.set(...f.target_mm);
      const right = new THREE.Vector3(...f.target_mm).sub(camera.position).cross(new THREE.Vector3(...f.up)).normalize();
      const roll = Math.abs(Math.asin(Math.min(1, Math.abs(right.z)))) * 180 / Math.PI;
      byId('frame-note').textContent = (f.picture ? '' : 'No picture.png lies beside the scene. ')
        + (roll > 0.5 ? `The camera is turned about its axis by ${roll.toFixed(1)}°; the view here is upright.` : '');
      if (f.picture) pictureUrl(f.picture).then((url) => { this.shot.src = url; }).catch((error: Error) => this.told(error.message));
    } else {
      this.stage.camera.fov = 40;
    }
    this.fit();
    this.stage.controls.update();
    this.stage.later();
  }

  /** The view as wide as the picture, the picture over it. */
  private fit(): void {
    const f = this.frames.find((g) => g.scene === this.current);
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
