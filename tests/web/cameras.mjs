// SPDX-License-Identifier: GPL-3.0-or-later

// node cameras.mjs FOLDER: three cameras on an arc over a part of 40 mm, one from straight above and
// one that is turned about its axis, as a trajectory of a scene (ring.toml, ring.csv), and the second
// one's picture as a photograph of a case (photo.toml)

import { writeFileSync } from 'node:fs';
import { join } from 'node:path';

const folder = process.argv[2];
const target = [20, 20, 2];
const minus = (a, b) => a.map((v, i) => v - b[i]), cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((v) => v / Math.hypot(...a));

/** Looks along -z, y up: w, x, y, z of model_from_camera. */
function lookAt(eye) {
  const z = unit(minus(eye, target)), x = unit(cross([0, 0, 1], z)), y = cross(z, x);
  const w = 0.5 * Math.sqrt(Math.max(1e-12, 1 + x[0] + y[1] + z[2]));
  return [w, (y[2] - z[1]) / (4 * w), (z[0] - x[2]) / (4 * w), (x[1] - y[0]) / (4 * w)];
}
const eyes = [-0.5, 0, 0.5].map((a) => [20 + 110 * Math.sin(a), 20 - 110 * Math.cos(a), 90]);
const lens = 'resolution_px = [240, 160]\npixel_pitch_um = 50\nfocal_length_mm = 30\n';
const lamp = 'lamp_position_mm = [-3500, 1300, 1400]\nlamp_target_mm = [20, 20, 2]\nexposure_scale = 2.5\nalbedo = 0.3\n';

/** Turned about its own z. */
function rolled([w, x, y, z], degrees) {
  const c = Math.cos(degrees * Math.PI / 360), s = Math.sin(degrees * Math.PI / 360);
  return [c * w - s * z, c * x + s * y, c * y - s * x, c * z + s * w];
}
const poses = [...eyes.map((eye) => [eye, lookAt(eye)]), [[24, 18, 110], rolled([1, 0, 0, 0], 40)], [eyes[2], rolled(lookAt(eyes[2]), -25)]];
writeFileSync(join(folder, 'ring.csv'), ['time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz',
  ...poses.map(([eye, q], i) => [0.5 * i, ...eye, ...q].join(','))].join('\n') + '\n');
writeFileSync(join(folder, 'ring.toml'), `schema = "maquette.scene/1"\nsurface = "design.tif"\nstones = "stones.json"\n${lens}${lamp}trajectory = "ring.csv"\n`);
writeFileSync(join(folder, 'photo.toml'), `schema = "maquette.case/1"\ndesign = "design.tif"\n[[photo]]\nimage = "shot.exr"\n${lens}${lamp}`
  + `camera_position_mm = [${eyes[1]}]\ncamera_quaternion_wxyz = [${lookAt(eyes[1])}]\nsurface = "design"\nheld_out = true\n`);
