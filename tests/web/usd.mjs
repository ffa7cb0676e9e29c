// SPDX-License-Identifier: GPL-3.0-or-later

// node usd.mjs PART.usda PART.stl: what `maquette export` has written of one part, read by three.js
//   the same triangles in the same order, the same floats
//   the stage's unit and up axis make metres with y up of it; matt paint

import { existsSync, readFileSync } from 'node:fs';
import { join } from 'node:path';

import { expect, finish, here, skip } from './packages.mjs';

if (!existsSync(join(here, 'node_modules/three'))) skip('three is not installed');
const { Box3, Vector3 } = await import('three');
const { USDLoader } = await import('three/addons/loaders/USDLoader.js');
const { STLLoader } = await import('three/addons/loaders/STLLoader.js');

const [usda, stl] = process.argv.slice(2);
const stage = new USDLoader().parse(readFileSync(usda, 'utf8'));
stage.updateMatrixWorld(true);
const meshes = [];
stage.traverse((o) => { if (o.isMesh) meshes.push(o); });
expect(meshes.length === 1, `${usda} has ${meshes.length} meshes`);
const [mesh] = meshes, { material } = mesh;
const bytes = readFileSync(stl);
const other = new STLLoader().parse(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length)).getAttribute('position');
// Corners as they follow, with or without an index.
const place = mesh.geometry.getAttribute('position'), { index } = mesh.geometry;
const count = index ? index.count : place.count;
expect(count === other.count, `${usda} has ${count} corners, ${stl} ${other.count}`);
let apart = 0;
for (let i = 0; i < Math.min(count, other.count); i += 1) {
  const at = index ? index.getX(i) : i;
  if (place.getX(at) !== other.getX(i) || place.getY(at) !== other.getY(i) || place.getZ(at) !== other.getZ(i)) apart += 1;
}
expect(apart === 0, `${apart} of ${count} corners are not those of ${stl}`);
const box = new Box3().setFromObject(stage), model = new Box3().setFromBufferAttribute(other);
const metres = (x, y, z) => new Vector3(x, z, -y).multiplyScalar(1e-3);
const wanted = new Box3().setFromPoints([metres(...model.min), metres(...model.max)]);
for (const end of ['min', 'max'])
  expect(box[end].distanceTo(wanted[end]) < 1e-9, `${usda}: ${end} is ${box[end].toArray()} m, not ${wanted[end].toArray()}`);
expect(material.metalness === 0 && material.roughness === 1 && Math.abs(material.color.r - 0.36) < 1e-6,
  `${usda}: the material is not matt paint`);
finish(`${count / 3} triangles of ${usda}`);
