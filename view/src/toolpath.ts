// SPDX-License-Identifier: GPL-3.0-or-later
// Programs as `run` and `verify` have thinned them (backplot/paths.json, tools/path_view.hpp), drawn
// up to a time of the machining. The file has each program's time and each stretch's feed; stretches
// get their share of the time by length over feed, rapids as if at kRapid.

import * as THREE from 'three';
import { getJson } from './contents';
import { byId, addOption } from './elements';
import { colourAt, drawBar, figure } from './palette';

interface PathScene {
  schema: string; low_mm: number[]; size_mm: number[];
  programs: { name: string; cut_mm: number; time_min: number; deviation_mm: number; left_out_mm: number;
    places: string; kinds: string; feed: string; engagement: string | null }[];
}
const kRapid = 10_000; // mm/min
const kRapidKind = 2;  // 0: first of a run
const kRapidColour = [0.75, 0, 0.59];

function words(text: string): Uint16Array {
  return new Uint16Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
}

export class Toolpath {
  readonly group = new THREE.Group();
  name = '';
  /** Share of the machining time that is drawn. */
  time = 1;
  playing = false;
  private scenes = new Map<string, Promise<PathScene>>();
  private places = new Float32Array();
  private kinds = new Uint8Array();
  private values: Record<string, Float32Array> = {};
  private clock = new Float64Array(); // minutes at the end of each segment that is drawn
  private ends = new Uint32Array();   // the place at which it ends
  private minutes = 0;
  private readonly lines = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ vertexColors: true }));
  private readonly tool = new THREE.Mesh(new THREE.SphereGeometry(1, 24, 16), new THREE.MeshLambertMaterial({ color: 0xff7a00 }));
  private last = 0;

  constructor(readonly files: string[], private readonly changed: () => void, told: (problem: string) => void) {
    this.lines.frustumCulled = false;
    this.group.add(this.lines, this.tool);
    this.group.visible = false;
    const program = byId<HTMLSelectElement>('program');
    byId('toolpath').hidden = files.length === 0;
    const failed = (file: string) => (error: Error) => told(`${file}: ${error.message}`);
    for (const file of files)
      this.scene(file).then((scene) => {
        scene.programs.forEach((p, i) => addOption(program, `${file}#${i}`, files.length > 1 ? `${file.split('/')[0]} ${p.name}` : p.name));
        program.dispatchEvent(new Event('filled'));
      }).catch(failed(file));
    program.addEventListener('change', () => { this.show(program.value).catch(failed(program.value)); });
    byId<HTMLSelectElement>('path-colour').addEventListener('change', () => this.colour());
    byId<HTMLInputElement>('rapids').addEventListener('change', () => this.build());
    const slider = byId<HTMLInputElement>('time');
    slider.addEventListener('input', () => { this.setTime(+slider.value); });
    byId('play').addEventListener('click', () => this.play(!this.playing));
  }

  private scene(file: string): Promise<PathScene> {
    let scene = this.scenes.get(file);
    if (!scene) {
      scene = getJson<PathScene>(file).then((s) => {
        if (s.schema !== 'maquette.path_view/1') throw new Error(`schema ${s.schema}, maquette.path_view/1 was expected`);
        return s;
      });
      this.scenes.set(file, scene);
    }
    return scene;
  }

  /** @param id file#number of the program; empty: none */
  async show(id: string): Promise<void> {
    this.play(false);
    byId<HTMLSelectElement>('program').value = id;
    this.name = id;
    this.group.visible = id !== '';
    byId('path-controls').hidden = id === '';
    if (id === '') { this.changed(); return; }
    const cut = id.lastIndexOf('#'), scene = await this.scene(id.slice(0, cut)), p = scene.programs[+id.slice(cut + 1)];
    if (!p || this.name !== id) return;
    const steps = words(p.places);
    this.kinds = Uint8Array.from(atob(p.kinds), (c) => c.charCodeAt(0));
    this.places = Float32Array.from(steps, (s, i) => scene.low_mm[i % 3]! + s / 65535 * scene.size_mm[i % 3]!);
    this.values = { feed: Float32Array.from(words(p.feed)), height: this.places.filter((_, i) => i % 3 === 2) };
    // 65535 (log10(mm^2) + 4) / 8 in the file.
    if (p.engagement) this.values.engagement = Float32Array.from(words(p.engagement), (w) => w / 65535 * 8 - 4);
    const select = byId<HTMLSelectElement>('path-colour');
    select.querySelector<HTMLOptionElement>('[value=engagement]')!.disabled = !p.engagement;
    if (!p.engagement && select.value === 'engagement') select.value = 'feed';
    this.minutes = p.time_min;
    this.tool.scale.setScalar(0.008 * Math.max(scene.size_mm[0]!, scene.size_mm[1]!));
    byId('path-note').textContent = `${p.name}: ${figure(p.cut_mm / 1000)} m of cuts, ${figure(p.time_min)} min; thinned, within `
      + `${figure(p.deviation_mm, 2)} mm of the program`
      + (p.left_out_mm > 0 ? `, ${figure(p.left_out_mm / 1000)} m of passes lie closer than is drawn` : '') + '.';
    this.build();
  }

  /** Segments in order, each with the clock at its end. */
  private build(): void {
    const { kinds, places } = this, rapids = byId<HTMLInputElement>('rapids').checked;
    const pairs: number[] = [], clock: number[] = [];
    let now = 0;
    for (let i = 1; i < kinds.length; i += 1) {
      if (kinds[i] === 0) continue;
      const rapid = kinds[i] === kRapidKind, d = [0, 1, 2].map((k) => places[3 * i + k]! - places[3 * i - 3 + k]!);
      now += Math.hypot(...d) / (rapid ? kRapid : Math.max(1, this.values.feed![i]!));
      if (rapid && !rapids) continue;
      pairs.push(i - 1, i);
      clock.push(now);
    }
    const share = now > 0 ? this.minutes / now : 0;
    this.clock = Float64Array.from(clock, (c) => c * share);
    this.ends = Uint32Array.from(pairs.filter((_, k) => k % 2 === 1));
    const position = new Float32Array(3 * pairs.length);
    pairs.forEach((i, k) => position.set(places.subarray(3 * i, 3 * i + 3), 3 * k));
    this.lines.geometry.dispose();
    this.lines.geometry = new THREE.BufferGeometry().setAttribute('position', new THREE.BufferAttribute(position, 3));
    this.colour();
    this.setTime(this.time);
  }

  private colour(): void {
    const by = byId<HTMLSelectElement>('path-colour').value, values = this.values[by];
    if (!values) return;
    let low = Infinity, high = -Infinity;
    for (const i of this.ends) if (this.kinds[i] !== kRapidKind) { low = Math.min(low, values[i]!); high = Math.max(high, values[i]!); }
    const colours = new Float32Array(6 * this.ends.length), c = new THREE.Color();
    this.ends.forEach((i, k) => {
      if (this.kinds[i] === kRapidKind) c.setRGB(kRapidColour[0]!, kRapidColour[1]!, kRapidColour[2]!, THREE.SRGBColorSpace);
      else c.setRGB(...colourAt(high > low ? (values[i]! - low) / (high - low) : 0, false), THREE.SRGBColorSpace);
      colours.set([c.r, c.g, c.b, c.r, c.g, c.b], 6 * k);
    });
    this.lines.geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
    drawBar(byId<HTMLCanvasElement>('path-bar'), false);
    const unit = { feed: 'mm/min', engagement: 'mm²', height: 'mm' }[by]!;
    const real = (v: number) => (by === 'engagement' ? 10 ** v : v);
    byId('path-ticks').replaceChildren(...[low, 0.5 * (low + high), high].map((v) => {
      const span = document.createElement('span');
      span.textContent = `${figure(real(v), 3)} ${unit}`;
      return span;
    }));
    this.changed();
  }

  setTime(share: number): void {
    this.time = Math.min(1, Math.max(0, share));
    const now = this.time * this.minutes;
    let from = 0, to = this.clock.length; // the first segment that ends later
    while (from < to) { const m = (from + to) >> 1; if (this.clock[m]! <= now) from = m + 1; else to = m; }
    this.lines.geometry.setDrawRange(0, this.time >= 1 ? Infinity : 2 * from);
    const at = this.ends[Math.min(from, this.ends.length - 1)];
    this.tool.visible = at !== undefined && this.time < 1;
    if (at !== undefined) this.tool.position.fromArray(this.places, 3 * at);
    const slider = byId<HTMLInputElement>('time');
    slider.value = String(this.time);
    slider.setAttribute('aria-valuetext', `${figure(now, 3)} minutes`);
    (slider.nextElementSibling as HTMLOutputElement).value = `${now.toFixed(1)} min`;
    this.changed();
  }

  play(on: boolean): void {
    this.playing = on;
    this.last = performance.now();
    if (on && this.time >= 1) this.time = 0;
    const button = byId('play');
    button.textContent = on ? 'pause' : 'play';
    button.setAttribute('aria-pressed', String(on));
    this.changed();
  }

  /** Before each picture. */
  advance(): void {
    if (!this.playing || this.minutes <= 0) return;
    const now = performance.now(), speed = +byId<HTMLSelectElement>('speed').value;
    const share = this.time + (now - this.last) / 60_000 * speed / this.minutes;
    this.last = now;
    this.setTime(share);
    if (share >= 1) this.play(false);
  }
}
