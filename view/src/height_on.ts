// SPDX-License-Identifier: GPL-3.0-or-later

/** Height of the triangulated grid, NaN beside it and over voids; x, y in nodes. */
export function heightOn(values: Float32Array, cols: number, rows: number, x: number, y: number): number {
  if (!(x >= 0 && y >= 0 && x <= cols - 1 && y <= rows - 1)) return NaN;
  const c = Math.min(Math.floor(x), cols - 2), r = Math.min(Math.floor(y), rows - 2);
  const u = x - c, v = y - r, i = r * cols + c;
  const a = values[i]!, f = values[i + cols + 1]!;
  if (u >= v) {
    const b = u > 0 ? values[i + 1]! : a; // a void that has no weight does not matter
    return a + u * (b - a) + (v > 0 ? v * (f - b) : 0);
  }
  const e = values[i + cols]!;
  return a + v * (e - a) + (u > 0 ? u * (f - e) : 0);
}
