// SPDX-License-Identifier: GPL-3.0-or-later
// Matt ground under a lamp, with the values of a field as colours over it: a texture in the model's
// x and y, so that tiles of any level wear it alike.

import * as THREE from 'three';
import { stops } from './palette';

export class GroundMaterial {
  readonly uniforms = {
    field: { value: null as THREE.Texture | null },
    coloured: { value: false },
    signedField: { value: true },
    fieldLow: { value: new THREE.Vector2() },   // mm, south-western texel's corner
    fieldSize: { value: new THREE.Vector2(1, 1) },
    scale: { value: new THREE.Vector2(0, 1) },  // values at the ends of the colour bar
    brush: { value: new THREE.Vector2(-1e30, 1e30) },
    signedStops: { value: stops(true).map((c) => new THREE.Color().setRGB(c[0] / 255, c[1] / 255, c[2] / 255, THREE.SRGBColorSpace)) },
    positiveStops: { value: stops(false).map((c) => new THREE.Color().setRGB(c[0] / 255, c[1] / 255, c[2] / 255, THREE.SRGBColorSpace)) },
  };
  readonly smooth = this.make(false);
  readonly faceted = this.make(true); // tiles without normals
  readonly stone = new THREE.MeshLambertMaterial({ color: 0xa9825c });

  private make(flatShading: boolean): THREE.MeshLambertMaterial {
    const material = new THREE.MeshLambertMaterial({ color: 0xc9c4ba, flatShading, polygonOffset: true,
      polygonOffsetFactor: 1, polygonOffsetUnits: 1, side: THREE.DoubleSide });
    material.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, this.uniforms);
      shader.vertexShader = shader.vertexShader
        .replace('#include <common>', '#include <common>\nvarying vec2 modelPlace;')
        .replace('#include <project_vertex>', '#include <project_vertex>\nmodelPlace = (modelMatrix * vec4(position, 1.0)).xy;');
      shader.fragmentShader = shader.fragmentShader
        .replace('#include <common>', `#include <common>
          varying vec2 modelPlace;
          uniform sampler2D field; uniform bool coloured, signedField;
          uniform vec2 fieldLow, fieldSize, scale, brush; uniform vec3 signedStops[3], positiveStops[6];`)
        // Hems of squares (raster_ground.ts) look as the edge that they hang from, from both sides.
        .replace('#include <normal_fragment_begin>', flatShading ? '#include <normal_fragment_begin>'
          : THREE.ShaderChunk.normal_fragment_begin.replace('gl_FrontFacing ? 1.0 : - 1.0', '1.0'))
        .replace('#include <color_fragment>', `#include <color_fragment>
          if (coloured) {
            vec2 at = (modelPlace - fieldLow) / fieldSize;
            float v = texture2D(field, at).r;
            ivec2 size = textureSize(field, 0);
            // Voids are 3e30, and so is what lies between them and values: there the nearest one counts.
            if (abs(v) >= 1e20) v = texelFetch(field, clamp(ivec2(at * vec2(size)), ivec2(0), size - 1), 0).r;
            bool there = abs(v) < 1e20;
            if (there && v >= brush.x && v <= brush.y) {
              float share = clamp((v - scale.x) / (scale.y - scale.x), 0.0, 1.0);
              if (signedField) {
                diffuseColor.rgb = share < 0.5 ? mix(signedStops[0], signedStops[1], 2.0 * share)
                                               : mix(signedStops[1], signedStops[2], 2.0 * share - 1.0);
              } else {
                float t = 5.0 * share;
                int i = min(int(t), 4);
                diffuseColor.rgb = mix(positiveStops[i], positiveStops[i + 1], t - float(i));
              }
            } else {
              diffuseColor.rgb *= there ? 0.45 : 0.25;
            }
          }`);
    };
    return material;
  }

  /** Puts the material on everything that was loaded. */
  dress(scene: THREE.Object3D): void {
    scene.traverse((o) => {
      if (!(o instanceof THREE.Mesh)) return;
      const old = o.material as THREE.Material;
      if (stoneNumbers(o)) o.material = this.stone;
      else o.material = o.geometry.getAttribute('normal') ? this.smooth : this.faceted;
      old.dispose();
    });
  }
}

/** Numbers of the stones that an object shows, in the order of its instances. */
export function stoneNumbers(object: THREE.Object3D | null): number[] | null {
  for (let o = object; o; o = o.parent) if (Array.isArray(o.userData.stones)) return o.userData.stones;
  return null;
}
