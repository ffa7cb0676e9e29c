// SPDX-License-Identifier: GPL-3.0-or-later
// Heights between two places, of one surface or of both panes'.

import { byId, svg, ticks } from './elements';
import { figure } from './palette';
import type { Surface } from './surface';
import type { Triple } from './contents';

const kPlaces = 500;
const kInks = ['light-dark(#0b5cad, #6fb5ff)', 'light-dark(#b2182b, #ff8a80)'];

export async function drawProfile(surfaces: Surface[], from: Triple, to: Triple): Promise<void> {
  const plot = byId<SVGSVGElement>('profile-plot'), text = byId('profile-text');
  byId('profile').hidden = false;
  text.textContent = 'reading heights…';
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
  const lines = await Promise.all(surfaces.flatMap((s) => (s.heights ? [s.heights(from, to, kPlaces)] : [])));
  const all = lines.flatMap((l) => l.values).filter((v): v is number => v !== null);
  plot.replaceChildren();
  if (all.length === 0) { text.textContent = 'There is no height on this line.'; return; }
  const width = plot.clientWidth || 800, height = 190, left = 52, top = 8, right = 10, bottom = 30;
  const low = Math.min(...all), high = Math.max(...all), pad = Math.max(0.05 * (high - low), 1e-3);
  const x = (i: number) => left + (width - left - right) * i / length;
  const y = (v: number) => top + (height - top - bottom) * (high + pad - v) / (high - low + 2 * pad);
  plot.setAttribute('viewBox', `0 0 ${width} ${height}`);
  for (const v of ticks(low - pad, high + pad, 5))
    plot.append(svg('line', { x1: left, x2: width - right, y1: y(v), y2: y(v), stroke: '#8884' }),
      svg('text', { x: left - 5, y: y(v) + 4, 'text-anchor': 'end' }, figure(v, 5)));
  for (const v of ticks(0, length, 8))
    plot.append(svg('line', { x1: x(v), x2: x(v), y1: top, y2: height - bottom, stroke: '#8882' }),
      svg('text', { x: x(v), y: height - bottom + 14, 'text-anchor': 'middle' }, figure(v, 5)));
  plot.append(svg('text', { x: width - right, y: height - 3, 'text-anchor': 'end' }, 'way along the line, mm; height, mm'));
  lines.forEach((line, k) => {
    let path = '', drawing = false;
    line.values.forEach((v, i) => {
      if (v !== null) path += `${drawing ? 'L' : 'M'}${x(length * i / (kPlaces - 1)).toFixed(1)} ${y(v).toFixed(1)}`;
      drawing = v !== null;
    });
    plot.append(svg('path', { d: path, fill: 'none', style: `stroke:${kInks[k]}`, 'stroke-width': 1.4 }));
  });
  const at = (p: Triple) => `x ${p[0].toFixed(2)}, y ${p[1].toFixed(2)}`;
  text.textContent = `From ${at(from)} to ${at(to)} mm: ${figure(length, 5)} mm long, heights ${figure(low, 5)} to `
    + `${figure(high, 5)} mm ${lines[0]!.exact}.`
    + (surfaces.length > 1 ? ` Blue: ${surfaces[0]!.name}; red: ${surfaces[1]!.name}.` : '');
  plot.setAttribute('aria-label', text.textContent);
}
