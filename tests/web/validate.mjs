// SPDX-License-Identifier: GPL-3.0-or-later

// node validate.mjs FOLDER...: each folder that `maquette lod` has written; of one without lod.json
// (maquette export) the first two, on each .glb
//   Khronos' validator ........ no error, no warning, on every .glb
//   inside the payload ........ unpacked by the official decoder, written plainly, validated again:
//                               indices in range, min and max as stated, normals of length one
//   whole numbers ............. positions are the lattice's
//   no crack, by what was decoded: tiles of one level, and of two levels that alternate like the
//                               fields of a chess board, welded by step * number: every edge has two
//                               triangles but on the outline
//   skirts .................... with --skirts, as high as stated; what is without them has no crack
//   pictures .................. of light for each tile with --textures, of normals for coarse ones, with
//                               --albedo of colours for all
//   material .................. is there, and as the folder's name says if that is one
//   boxes ..................... every decoded vertex lies in the box of its tile

import { existsSync, readFileSync, readdirSync, statSync } from 'node:fs';
import { join, relative } from 'node:path';

import { plainAgain, readGlb, turned, unpack } from './glb.mjs';
import { expect, finish, load } from './packages.mjs';

const validator = load('gltf-validator');

async function valid(bytes, what, roundedNormals) {
  const report = await validator.validateBytes(new Uint8Array(bytes), {
    maxIssues: 100,
    // Eight bits of each component leave a normal's length off one by up to a per cent; where the
    // validator sees bytes it knows that, in floats it does not.
    severityOverrides: roundedNormals ? { ACCESSOR_VECTOR3_NON_UNIT: 2 } : {},
  });
  const worst = report.issues.messages.filter((m) => m.severity < 2);
  expect(report.issues.numErrors === 0 && report.issues.numWarnings === 0,
    `${what}: ${JSON.stringify(worst.slice(0, 3))}`);
}

function files(folder) {
  return readdirSync(folder).flatMap((name) => {
    const path = join(folder, name);
    return statSync(path).isDirectory() ? files(path) : path.endsWith('.glb') ? [path] : [];
  });
}

/** Edges that have no partner; keys are whole numbers of the set's frame. */
function openEdges(tiles) {
  const edges = new Set();
  let overlaps = 0;
  for (const { corners, indices } of tiles)
    for (let i = 0; i < indices.length; i += 3)
      for (let k = 0; k < 3; k += 1) {
        const a = corners[indices[i + k]], b = corners[indices[i + ((k + 1) % 3)]];
        if (edges.has(`${a}>${b}`)) overlaps += 1;
        edges.add(`${a}>${b}`);
      }
  const open = [];
  for (const edge of edges) {
    const [a, b] = edge.split('>');
    if (!edges.has(`${b}>${a}`)) open.push([a.split(','), b.split(',')]);
  }
  return { open, overlaps };
}

let count = 0;
for (const folder of process.argv.slice(2)) {
  if (!existsSync(join(folder, 'lod.json'))) {
    const glbs = files(folder);
    expect(glbs.length > 0, `${folder} has no .glb`);
    for (const path of glbs) {
      count += 1;
      const bytes = readFileSync(path), glb = readGlb(new Uint8Array(bytes));
      await valid(bytes, path, false);
      await valid(plainAgain(glb, await unpack(glb)), `${path}, unpacked`, false);
    }
    continue;
  }
  const lod = JSON.parse(readFileSync(join(folder, 'lod.json')));
  // Metres of a step: at model size, or full size on a body.
  const [wide, high] = lod.metres_per_model_metre.map((m) => 1e-3 * m * lod.step_mm), steps = [wide, high, wide];
  const boxes = new Map();
  const walk = (tile) => {
    if (tile.content) boxes.set(tile.content.uri, tile.boundingVolume.box);
    for (const child of tile.children ?? []) walk(child);
  };
  walk(JSON.parse(readFileSync(join(folder, 'tileset.json'))).root);
  const levels = new Map();
  for (const path of files(folder)) {
    count += 1;
    const bytes = readFileSync(path);
    await valid(bytes, path, false);
    if (relative(folder, path).startsWith('stones')) continue;
    const glb = readGlb(new Uint8Array(bytes));
    const inside = await unpack(glb), material = glb.json.materials[0].name;
    expect(material === (['regolith', 'foil'].includes(folder) ? folder : 'paint'), `${path}: the material is ${material}`);
    expect((lod.normal_bits > 0) === Boolean(inside.attributes.NORMAL), `${path}: normals`);
    const pictures = glb.json.images?.length ?? 0, full = path.includes(`tiles/${lod.levels.length - 1}/`);
    expect(pictures === (lod.texels === 0 ? 0 : full ? 1 : 2) + (lod.albedo ? 1 : 0), `${path}: ${pictures} pictures`);
    await valid(plainAgain(glb, inside), `${path}, unpacked`, lod.compression === 'meshopt');
    const p = turned(glb.json.nodes[0], inside.attributes.POSITION);
    const origin = glb.json.nodes[0].translation.map((t, k) => Math.round(t / steps[k]));
    const uri = relative(folder, path);
    const box = boxes.get(uri);
    expect(box !== undefined, `${uri} is not in tileset.json`);
    const n = turned(glb.json.nodes[0], inside.attributes.NORMAL ?? new Float32Array());
    for (let i = 0; i < n.length; i += 3)
      expect(Math.abs(Math.hypot(n[i], n[i + 1], n[i + 2]) - 1) < 0.01 && n[i + 1] > 0, `${uri}: normal ${i / 3}`);
    const corners = [];
    let whole = true, inBox = true;
    for (let i = 0; i < p.length; i += 3) {
      whole &&= Number.isInteger(p[i]) && Number.isInteger(p[i + 1]) && Number.isInteger(p[i + 2]);
      const [x, y, z] = [p[i] + origin[0], p[i + 1] + origin[1], p[i + 2] + origin[2]];
      inBox &&= Math.abs(x * wide - box[0]) <= box[3] && Math.abs(-z * wide - box[1]) <= box[7] &&
        Math.abs(y * high - box[2]) <= box[11];
      corners.push(`${x},${y},${z}`);
    }
    // Skirts are all that is upright: two corners above each other.
    const ground = [], skirt = Math.round(lod.levels.find((l) => l.depth === +uri.split('/')[1]).skirt_mm / lod.step_mm);
    let drops = 0;
    for (let i = 0; i < inside.indices.length; i += 3) {
      const t = [...inside.indices.subarray(i, i + 3)];
      const above = [[0, 1], [1, 2], [2, 0]].find(([a, b]) => [0, 2].every((k) => p[3 * t[a] + k] === p[3 * t[b] + k]));
      if (!above) { ground.push(...t); continue; }
      drops += 1;
      expect(Math.abs(p[3 * t[above[0]] + 1] - p[3 * t[above[1]] + 1]) === skirt, `${uri}: a skirt is not ${skirt} steps high`);
    }
    expect((drops > 0) === (skirt > 0 && !uri.startsWith('tiles/0/')), `${uri}: ${drops} triangles of skirts`);
    expect(whole, `${uri}: positions are not whole numbers`);
    expect(inBox, `${uri}: vertices outside the box`);
    const [, depth, column, row] = uri.split('/');
    if (!levels.has(+depth)) levels.set(+depth, []);
    levels.get(+depth).push({ column: +column, row: parseInt(row, 10), corners, indices: ground });
  }
  const width = (lod.nodes[0] - 1) * lod.steps_per_quad, height = (lod.nodes[1] - 1) * lod.steps_per_quad;
  const check = (tiles, what) => {
    const { open, overlaps } = openEdges(tiles);
    expect(overlaps === 0, `${folder}, ${what}: ${overlaps} edges twice`);
    const inner = open.filter(([a, b]) => !(
      (a[0] === b[0] && (+a[0] === 0 || +a[0] === width)) || (a[2] === b[2] && (+a[2] === 0 || +a[2] === -height))));
    expect(inner.length === 0, `${folder}, ${what}: ${inner.length} open edges, first ${inner[0]}`);
  };
  const depths = [...levels.keys()].sort((a, b) => a - b);
  for (const fine of depths) {
    check(levels.get(fine), `depth ${fine}`);
    for (const coarse of depths.filter((d) => d < fine)) {
      const isCoarse = (column, row) => (column + row) % 2 === 0;
      const shift = fine - coarse;
      check([...levels.get(coarse).filter((t) => isCoarse(t.column, t.row)),
        ...levels.get(fine).filter((t) => !isCoarse(t.column >> shift, t.row >> shift))],
      `depths ${coarse} and ${fine}`);
    }
  }
}
finish(`${count} files`);
