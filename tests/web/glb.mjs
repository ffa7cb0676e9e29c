// SPDX-License-Identifier: GPL-3.0-or-later

// A glTF binary read and its payload unpacked by the formats' own decoders: Draco's
// (draco3dgltf) and meshoptimizer's.

import { load } from './packages.mjs';

const kFloat = 5126;
const arrays = { 5120: Int8Array, 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const width = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

export function readGlb(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const size = view.getUint32(12, true);
  return {
    json: JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + size))),
    binary: bytes.subarray(28 + size),
  };
}

export function writeGlb(json, binary) {
  let text = JSON.stringify(json);
  while (text.length % 4 !== 0) text += ' ';
  const bytes = new Uint8Array(28 + text.length + binary.length);
  const view = new DataView(bytes.buffer);
  [0x46546c67, 2, bytes.length, text.length, 0x4e4f534a].forEach((x, i) => view.setUint32(4 * i, x, true));
  bytes.set(new TextEncoder().encode(text), 20);
  view.setUint32(20 + text.length, binary.length, true);
  view.setUint32(24 + text.length, 0x004e4942, true);
  bytes.set(binary, 28 + text.length);
  return bytes;
}

let dracoModule;
async function unpackDraco(json, binary) {
  dracoModule ??= await load('draco3dgltf').createDecoderModule({});
  const draco = dracoModule;
  const primitive = json.meshes[0].primitives[0];
  const extension = primitive.extensions.KHR_draco_mesh_compression;
  const view = json.bufferViews[extension.bufferView];
  const decoder = new draco.Decoder();
  const buffer = new draco.DecoderBuffer();
  buffer.Init(new Int8Array(binary.slice(view.byteOffset, view.byteOffset + view.byteLength).buffer), view.byteLength);
  const mesh = new draco.Mesh();
  const status = decoder.DecodeBufferToMesh(buffer, mesh);
  if (!status.ok()) throw new Error(`Draco: ${status.error_msg()}`);
  const unpacked = {};
  for (const [name, id] of Object.entries(extension.attributes)) {
    const attribute = decoder.GetAttributeByUniqueId(mesh, id);
    const size = 4 * attribute.num_components() * mesh.num_points(), at = draco._malloc(size);
    decoder.GetAttributeDataArrayForAllPoints(mesh, attribute, draco.DT_FLOAT32, size, at);
    unpacked[name] = new Float32Array(draco.HEAPU8.slice(at, at + size).buffer);
    draco._free(at);
  }
  const bytes = mesh.num_faces() * 12;
  const pointer = draco._malloc(bytes);
  decoder.GetTrianglesUInt32Array(mesh, bytes, pointer);
  const indices = new Uint32Array(draco.HEAPU8.slice(pointer, pointer + bytes).buffer);
  draco._free(pointer);
  for (const object of [mesh, buffer, decoder]) draco.destroy(object);
  return { attributes: unpacked, indices };
}

async function unpackMeshopt(json, binary) {
  const { MeshoptDecoder } = load('meshoptimizer');
  await MeshoptDecoder.ready;
  const accessor = (i) => {
    const a = json.accessors[i];
    const e = json.bufferViews[a.bufferView].extensions.EXT_meshopt_compression;
    const out = new Uint8Array(e.count * e.byteStride);
    MeshoptDecoder.decodeGltfBuffer(
      out, e.count, e.byteStride, binary.subarray(e.byteOffset, e.byteOffset + e.byteLength), e.mode, e.filter ?? 'NONE');
    const values = new arrays[a.componentType](out.buffer);
    if (e.mode !== 'ATTRIBUTES') return Uint32Array.from(values);
    const stride = e.byteStride / values.BYTES_PER_ELEMENT;
    const scale = a.normalized ? (a.componentType === 5123 ? 65535 : 127) : 1, n = width[a.type];
    return Float32Array.from({ length: n * a.count }, (_, k) => values[Math.floor(k / n) * stride + (k % n)] / scale);
  };
  const primitive = json.meshes[0].primitives[0];
  const attributes = {};
  for (const [name, i] of Object.entries(primitive.attributes)) attributes[name] = accessor(i);
  return { attributes, indices: accessor(primitive.indices) };
}

function unpackPlain(json, binary) {
  const accessor = (i) => {
    const a = json.accessors[i];
    const at = json.bufferViews[a.bufferView].byteOffset;
    const Type = arrays[a.componentType];
    const bytes = binary.slice(at, at + a.count * width[a.type] * Type.BYTES_PER_ELEMENT);
    return new Type(bytes.buffer);
  };
  const primitive = json.meshes[0].primitives[0];
  const attributes = {};
  for (const [name, i] of Object.entries(primitive.attributes)) attributes[name] = accessor(i);
  return { attributes, indices: Uint32Array.from(accessor(primitive.indices)) };
}

/** Attributes as floats and indices of the first primitive, whatever packs them. */
export async function unpack({ json, binary }) {
  const used = json.extensionsUsed ?? [];
  if (used.includes('KHR_draco_mesh_compression')) return unpackDraco(json, binary);
  if (used.includes('EXT_meshopt_compression')) return unpackMeshopt(json, binary);
  return unpackPlain(json, binary);
}

/** Vectors in the axes of the node's parent, turned by its rotation if it has one. */
export function turned({ rotation }, vectors) {
  const [x, y, z, w] = rotation ?? [0, 0, 0, 1];
  const out = new Float64Array(vectors.length);
  for (let i = 0; i < vectors.length; i += 3) {
    const [a, b, c] = vectors.subarray(i, i + 3);
    const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
    out[i] = a + w * p + (y * r - z * q);
    out[i + 1] = b + w * q + (z * p - x * r);
    out[i + 2] = c + w * r + (x * q - y * p);
  }
  return out;
}

/** The same tile without compression, for a validator that does not look inside; pictures as they are. */
export function plainAgain({ json, binary: stored }, { attributes, indices }) {
  const data = [attributes.POSITION, indices];
  if (attributes.NORMAL) data.push(attributes.NORMAL);
  if (attributes.TEXCOORD_0) data.push(attributes.TEXCOORD_0);
  if (attributes.TANGENT) data.push(attributes.TANGENT);
  const targets = [34962, 34963, 34962, 34962, 34962];
  const images = json.images ?? [];
  const pictures = images.map(({ bufferView }) => {
    const { byteOffset, byteLength } = json.bufferViews[bufferView];
    return stored.subarray(byteOffset, byteOffset + byteLength);
  });
  const padded = (n) => 4 * Math.ceil(n / 4);
  const binary = new Uint8Array([...data, ...pictures].reduce((sum, d) => sum + padded(d.byteLength), 0));
  const bufferViews = [];
  let at = 0;
  data.forEach((d, i) => {
    bufferViews.push({ buffer: 0, byteOffset: at, byteLength: d.byteLength, target: targets[i] });
    binary.set(new Uint8Array(d.buffer, d.byteOffset, d.byteLength), at);
    at += d.byteLength;
  });
  const views = data.length;
  for (const picture of pictures) {
    bufferViews.push({ buffer: 0, byteOffset: at, byteLength: picture.length });
    binary.set(picture, at);
    at += padded(picture.length);
  }
  const vertices = attributes.POSITION.length / 3;
  const accessors = [
    { bufferView: 0, componentType: kFloat, count: vertices, type: 'VEC3',
      min: json.accessors[0].min, max: json.accessors[0].max },
    { bufferView: 1, componentType: 5125, count: indices.length, type: 'SCALAR' },
  ];
  const names = { POSITION: 0 };
  if (attributes.NORMAL) {
    accessors.push({ bufferView: 2, componentType: kFloat, count: vertices, type: 'VEC3' });
    names.NORMAL = 2;
  }
  if (attributes.TEXCOORD_0) {
    accessors.push({ bufferView: 3, componentType: kFloat, count: vertices, type: 'VEC2' });
    names.TEXCOORD_0 = 3;
  }
  if (attributes.TANGENT) {
    accessors.push({ bufferView: 4, componentType: kFloat, count: vertices, type: 'VEC4' });
    names.TANGENT = 4;
  }
  const drawn = images.length === 0 ? {} : {
    images: images.map(({ mimeType }, i) => ({ mimeType, bufferView: views + i })),
    textures: json.textures, samplers: json.samplers,
  };
  return writeGlb(
    { asset: { version: '2.0' }, scene: 0, scenes: [{ nodes: [0] }], nodes: json.nodes, materials: json.materials,
      meshes: [{ primitives: [{ attributes: names, indices: 1, material: 0 }] }],
      buffers: [{ byteLength: at }], bufferViews, accessors, ...drawn },
    binary);
}
