// SPDX-License-Identifier: GPL-3.0-or-later
// Colours of a field (deviation, residual, what a ball leaves): colour bar, and a histogram on which
// a brush chooses the values that keep their colour. A second field (residuals after, beside those
// before) has the other pane, the same scale and an outline in the histogram.

import * as THREE from 'three';
import { getGrid, type FieldEntry, type Grid } from './contents';
import { byId, svg } from './elements';
import type { GroundMaterial } from './ground_material';
import { colourAt, drawBar, figure } from './palette';

const kNodes = 1024, kBins = 80;

/** Fields that are looked at with one scale have one name but for when they are of. */
function pairOf(path: string): string {
  return path.replace(/_(before|after)\.tif$/, '');
}

interface Shown { entry: FieldEntry; grid: Grid; texture: THREE.DataTexture; values: Float32Array }

export class FieldColours {
  limit = 1;
  brush: [number, number] = [-Infinity, Infinity];
  /** The field of the left pane, or of both, and where there is one that of the right. */
  private shown: Shown[] = [];
  private readonly histogram = byId<SVGSVGElement>('histogram');
  private readonly limitInput = byId<HTMLInputElement>('limit');
  private readonly lowInput = byId<HTMLInputElement>('brush-low');
  private readonly highInput = byId<HTMLInputElement>('brush-high');
  private readonly linear: boolean;

  constructor(private readonly material: GroundMaterial, renderer: THREE.WebGLRenderer, private readonly changed: () => void) {
    this.linear = renderer.extensions.has('OES_texture_float_linear');
    this.limitInput.addEventListener('change', () => {
      if (+this.limitInput.value > 0) { this.limit = +this.limitInput.value; this.apply(); }
    });
    const typed = (input: HTMLInputElement, side: 0 | 1) => input.addEventListener('change', () => {
      this.brush[side] = input.value === '' ? (side ? Infinity : -Infinity) : +input.value;
      this.apply();
    });
    typed(this.lowInput, 0);
    typed(this.highInput, 1);
    byId('brush-all').addEventListener('click', () => { this.brush = [-Infinity, Infinity]; this.apply(); });
    let from: number | null = null;
    const value = (event: PointerEvent) => {
      const box = this.histogram.getBoundingClientRect();
      return this.low() + (event.clientX - box.left) / box.width * (this.limit - this.low());
    };
    this.histogram.addEventListener('pointerdown', (event) => {
      from = value(event);
      this.histogram.setPointerCapture(event.pointerId);
    });
    this.histogram.addEventListener('pointermove', (event) => {
      if (from === null) return;
      const to = value(event);
      this.brush = [Math.min(from, to), Math.max(from, to)];
      this.apply();
    });
    this.histogram.addEventListener('pointerup', (event) => {
      if (from !== null && Math.abs(value(event) - from) < 0.01 * this.limit) this.brush = [-Infinity, Infinity];
      from = null;
      this.apply();
    });
  }

  get entries(): FieldEntry[] { return this.shown.map((s) => s.entry); }
  get entry(): FieldEntry | null { return this.shown[0]?.entry ?? null; }

  private low(): number { return this.entry?.kind === 'signed' ? -this.limit : 0; }

  private async read(entry: FieldEntry): Promise<Shown> {
    const grid = await getGrid(entry.path, kNodes, true);
    const texels = grid.values.map((v) => (Number.isFinite(v) ? v : 3e30));
    const texture = new THREE.DataTexture(texels, grid.cols, grid.rows, THREE.RedFormat, THREE.FloatType);
    texture.minFilter = texture.magFilter = this.linear ? THREE.LinearFilter : THREE.NearestFilter;
    texture.needsUpdate = true;
    return { entry, grid, texture, values: grid.values.filter((v) => Number.isFinite(v)) };
  }

  /** None takes the colours off; of two the second is the right pane's. */
  async show(entries: FieldEntry[]): Promise<void> {
    const before = this.entry;
    const shown = await Promise.all(entries.map((e) => this.shown.find((s) => s.entry === e) ?? this.read(e)));
    for (const old of this.shown) if (!shown.includes(old)) old.texture.dispose();
    this.shown = shown;
    const first = shown[0];
    byId('colour-scale').hidden = !first;
    this.material.uniforms.coloured.value = Boolean(first);
    if (first) {
      const { entry, grid } = first;
      // Before and after have one scale, whichever is looked at first.
      if (!before || pairOf(before.path) !== pairOf(entry.path)) {
        const sizes = first.values.map((v) => Math.abs(v)).sort();
        // 99 of 100 places are within the colours.
        this.limit = Number((sizes[Math.floor(0.99 * (sizes.length - 1))] || 1).toPrecision(2));
        this.brush = [-Infinity, Infinity];
      }
      byId('limit-unit').textContent = entry.unit;
      byId('colour-note').textContent = [grid.whole ? '' : `Colours are means over ${figure(grid.dx_mm, 3)} mm.`,
        shown[1] ? `Bars: ${entry.path}; line: ${shown[1].entry.path}.` : ''].join(' ').trim();
      drawBar(byId<HTMLCanvasElement>('bar'), entry.kind === 'signed');
    }
    this.dress(0);
    this.apply();
  }

  /** What is drawn at a place that has a void beside it. */
  nearest(path: string, x: number, y: number): number | null {
    const g = this.shown.find((s) => s.entry.path === path)?.grid;
    if (!g) return null;
    const c = Math.round((x - g.x0_mm) / g.dx_mm), r = Math.round((y - g.y0_mm) / g.dy_mm);
    const v = c >= 0 && r >= 0 && c < g.cols && r < g.rows ? g.values[r * g.cols + c]! : NaN;
    return Number.isNaN(v) ? null : v;
  }

  /** Before a pane is drawn: its field. */
  dress(pane: number): void {
    const shown = this.shown[pane] ?? this.shown[0], u = this.material.uniforms;
    if (!shown) return;
    const { grid } = shown;
    u.field.value = shown.texture;
    u.signedField.value = shown.entry.kind === 'signed';
    u.fieldLow.value.set(grid.x0_mm - 0.5 * grid.dx_mm, grid.y0_mm - 0.5 * grid.dy_mm);
    u.fieldSize.value.set(grid.cols * grid.dx_mm, grid.rows * grid.dy_mm);
  }

  private counts(values: Float32Array): number[] {
    const bins: number[] = new Array(kBins).fill(0), low = this.low();
    for (const v of values) {
      const i = Math.floor((v - low) / (this.limit - low) * kBins);
      if (i >= 0 && i < kBins) bins[i]! += 1;
    }
    return bins;
  }

  apply(): void {
    const { entry, limit, brush } = this;
    if (entry) {
      const low = this.low(), signed = entry.kind === 'signed';
      this.material.uniforms.scale.value.set(low, limit);
      this.material.uniforms.brush.value.set(Math.max(-1e30, brush[0]), Math.min(1e30, brush[1]));
      this.limitInput.value = String(limit);
      const shown = (v: number) => (Number.isFinite(v) ? String(Number(v.toPrecision(3))) : '');
      this.lowInput.value = shown(brush[0]);
      this.highInput.value = shown(brush[1]);
      byId('ticks').replaceChildren(...[low, 0.5 * (low + limit), limit].map((v) => {
        const span = document.createElement('span');
        span.textContent = `${v > 0 && signed ? '+' : ''}${figure(v, 3)} ${entry.unit}`;
        return span;
      }));
      const [first, second] = this.shown, bins = this.counts(first!.values), line = second ? this.counts(second.values) : [];
      const inside = first!.values.reduce((n, v) => n + (v >= brush[0] && v <= brush[1] ? 1 : 0), 0);
      const most = Math.max(...bins, ...line, 1);
      this.histogram.setAttribute('viewBox', `0 0 ${kBins} 100`);
      this.histogram.setAttribute('preserveAspectRatio', 'none');
      this.histogram.setAttribute('aria-label', `histogram; ${(100 * inside / Math.max(1, first!.values.length)).toFixed(1)} % of the places keep their colour`);
      this.histogram.replaceChildren(...bins.map((n, i) => {
        const v = low + (i + 0.5) / kBins * (limit - low), kept = v >= brush[0] && v <= brush[1];
        const c = colourAt((i + 0.5) / kBins, signed).map((x) => Math.round(255 * x));
        return svg('rect', { x: i, y: 100 - 100 * n / most, width: 1.02, height: 100 * n / most,
          fill: kept ? `rgb(${c.join(',')})` : '#8884', stroke: kept ? '#8886' : 'none', 'stroke-width': 0.1 });
      }));
      if (second)
        this.histogram.append(svg('path', { d: line.map((n, i) => `${i ? 'L' : 'M'}${i} ${100 - 100 * n / most}H${i + 1}`).join(''),
          fill: 'none', stroke: 'currentColor', 'stroke-width': 1.5, 'vector-effect': 'non-scaling-stroke' }));
    }
    this.changed();
  }
}
