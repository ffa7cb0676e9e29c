// SPDX-License-Identifier: GPL-3.0-or-later
// Colours of a field (deviation, residual, what a ball leaves): colour bar, and a histogram on which
// a brush chooses the values that keep their colour.

import * as THREE from 'three';
import { getGrid, type FieldEntry } from './contents';
import { byId, svg } from './elements';
import type { GroundMaterial } from './ground_material';
import { colourAt, drawBar, figure } from './palette';

const kNodes = 1024, kBins = 80;

export class FieldColours {
  entry: FieldEntry | null = null;
  limit = 1;
  brush: [number, number] = [-Infinity, Infinity];
  private texture: THREE.DataTexture | null = null;
  private bins: number[] = [];
  private readonly histogram = byId<SVGSVGElement>('histogram');
  private readonly limitInput = byId<HTMLInputElement>('limit');
  private readonly lowInput = byId<HTMLInputElement>('brush-low');
  private readonly highInput = byId<HTMLInputElement>('brush-high');
  private values = new Float32Array();
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

  private low(): number { return this.entry?.kind === 'signed' ? -this.limit : 0; }

  /** Null takes the colours off. */
  async show(entry: FieldEntry | null): Promise<void> {
    const grid = entry ? await getGrid(entry.path, kNodes, true) : null;
    this.entry = entry;
    this.texture?.dispose();
    this.texture = null;
    byId('colour-scale').hidden = !entry;
    this.material.uniforms.coloured.value = Boolean(entry);
    if (entry && grid) {
      this.values = grid.values.filter((v) => Number.isFinite(v));
      const sizes = this.values.map((v) => Math.abs(v)).sort();
      // 99 of 100 places are within the colours.
      this.limit = Number((sizes[Math.floor(0.99 * (sizes.length - 1))] || 1).toPrecision(2));
      this.brush = [-Infinity, Infinity];
      const texels = grid.values.map((v) => (Number.isFinite(v) ? v : 3e30));
      this.texture = new THREE.DataTexture(texels, grid.cols, grid.rows, THREE.RedFormat, THREE.FloatType);
      this.texture.minFilter = this.texture.magFilter = this.linear ? THREE.LinearFilter : THREE.NearestFilter;
      this.texture.needsUpdate = true;
      const u = this.material.uniforms;
      u.field.value = this.texture;
      u.signedField.value = entry.kind === 'signed';
      u.fieldLow.value.set(grid.x0_mm - 0.5 * grid.dx_mm, grid.y0_mm - 0.5 * grid.dy_mm);
      u.fieldSize.value.set(grid.cols * grid.dx_mm, grid.rows * grid.dy_mm);
      byId('limit-unit').textContent = entry.unit;
      byId('colour-note').textContent = grid.whole ? '' : `Colours are means over ${figure(grid.dx_mm, 3)} mm.`;
      drawBar(byId<HTMLCanvasElement>('bar'), entry.kind === 'signed');
    }
    this.apply();
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
      this.bins = new Array(kBins).fill(0);
      let inside = 0;
      for (const v of this.values) {
        const i = Math.floor((v - low) / (limit - low) * kBins);
        if (i >= 0 && i < kBins) this.bins[i]! += 1;
        if (v >= brush[0] && v <= brush[1]) inside += 1;
      }
      const most = Math.max(...this.bins, 1);
      this.histogram.setAttribute('viewBox', `0 0 ${kBins} 100`);
      this.histogram.setAttribute('preserveAspectRatio', 'none');
      this.histogram.setAttribute('aria-label', `histogram; ${(100 * inside / Math.max(1, this.values.length)).toFixed(1)} % of the places keep their colour`);
      this.histogram.replaceChildren(...this.bins.map((n, i) => {
        const v = low + (i + 0.5) / kBins * (limit - low), kept = v >= brush[0] && v <= brush[1];
        const c = colourAt((i + 0.5) / kBins, signed).map((x) => Math.round(255 * x));
        return svg('rect', { x: i, y: 100 - 100 * n / most, width: 1.02, height: 100 * n / most,
          fill: kept ? `rgb(${c.join(',')})` : '#8884', stroke: kept ? '#8886' : 'none', 'stroke-width': 0.1 });
      }));
    }
    this.changed();
  }
}
