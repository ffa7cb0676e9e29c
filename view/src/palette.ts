// SPDX-License-Identifier: GPL-3.0-or-later
// The colours of our reports: deviations as in deviation_view.js, quantities as backplot_colour().

export type Colour = [number, number, number];
const kSigned: Colour[] = [[33, 102, 173], [247, 247, 247], [179, 23, 43]];
const kPositive: Colour[] = [[48, 18, 117], [40, 110, 200], [30, 160, 135], [120, 190, 60], [235, 185, 40], [190, 35, 20]];

export function stops(signed: boolean): Colour[] {
  return signed ? kSigned : kPositive;
}

/** @param share from 0 to 1 of the scale; channels from 0 to 1, sRGB */
export function colourAt(share: number, signed: boolean): Colour {
  const list = stops(signed);
  const t = Math.min(1, Math.max(0, share)) * (list.length - 1);
  const i = Math.min(Math.floor(t), list.length - 2);
  return [0, 1, 2].map((k) => (list[i]![k]! + (t - i) * (list[i + 1]![k]! - list[i]![k]!)) / 255) as Colour;
}

export function drawBar(canvas: HTMLCanvasElement, signed: boolean): void {
  const pen = canvas.getContext('2d')!;
  for (let x = 0; x < canvas.width; x += 1) {
    pen.fillStyle = `rgb(${colourAt(x / (canvas.width - 1), signed).map((c) => Math.round(255 * c)).join(',')})`;
    pen.fillRect(x, 0, 1, canvas.height);
  }
}

/** As a person reads it. */
export function figure(v: number, digits = 4): string {
  if (!Number.isFinite(v)) return '–';
  return String(Number(v.toPrecision(digits)));
}
