// What the page's own libraries make of a model's files: Khronos' validator, three's Draco decoder and its KTX2 reader.
// Run in a folder whose node_modules holds three and gltf-validator, with files as arguments. Exit 1 with a line for
// whatever is wrong.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const require = createRequire(process.cwd() + "/");
const validator = require("gltf-validator");
const libraries = process.cwd() + "/node_modules/three/examples/jsm/libs/";
// A script for browsers, which leaves its one function behind.
const script = readFileSync(libraries + "draco/gltf/draco_decoder.js", "utf8");
const draco = await new Function("require", "__dirname", script + "; return DracoDecoderModule;")(require, libraries)();
const { read: readKtx } = await import(pathToFileURL(libraries + "ktx-parse.module.js").href);

let faults = 0;
function fault(file, text) {
  console.log(`${file}: ${text}`);
  ++faults;
}

function floats(decoder, mesh, attribute) {
  const values = new draco.DracoFloat32Array();
  decoder.GetAttributeFloatForAllPoints(mesh, attribute, values);
  return Float32Array.from({ length: values.size() }, (_, k) => values.GetValue(k));
}

async function checkTile(file, bytes) {
  const { issues } = await validator.validateBytes(bytes);
  if (issues.numErrors + issues.numWarnings > 0) fault(file, JSON.stringify(issues.messages));
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const textBytes = view.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + textBytes)));
  const packed = json.meshes[0].primitives[0].extensions.KHR_draco_mesh_compression;
  const { byteOffset = 0, byteLength } = json.bufferViews[packed.bufferView];
  const data = bytes.subarray(28 + textBytes + byteOffset, 28 + textBytes + byteOffset + byteLength);
  const decoder = new draco.Decoder();
  const mesh = new draco.Mesh();
  const status = decoder.DecodeArrayToMesh(new Int8Array(data), data.byteLength, mesh);
  if (!status.ok()) return fault(file, `Draco: ${status.error_msg()}`);
  const { attributes, indices } = json.meshes[0].primitives[0];
  if (json.accessors[indices].count !== 3 * mesh.num_faces()) fault(file, "another number of triangles");
  for (const [name, accessor] of Object.entries(attributes)) {
    const attribute = decoder.GetAttributeByUniqueId(mesh, packed.attributes[name]);
    const values = floats(decoder, mesh, attribute);
    if (values.length !== mesh.num_points() * attribute.num_components()) fault(file, `${name} is not whole`);
    if (json.accessors[accessor].count !== mesh.num_points()) fault(file, `${name}: another number of vertices`);
    if (name !== "POSITION") continue;
    if (!values.every(Number.isInteger)) fault(file, "positions are no whole steps");
    for (let axis = 0; axis < 3; ++axis) {
      const along = values.filter((_, k) => k % 3 === axis);
      if (along.reduce((a, b) => Math.min(a, b)) !== json.accessors[accessor].min[axis]) fault(file, "another least place");
      if (along.reduce((a, b) => Math.max(a, b)) !== json.accessors[accessor].max[axis]) fault(file, "another greatest place");
    }
  }
}

function checkTexture(file, bytes) {
  const texture = readKtx(bytes);
  if (texture.vkFormat !== 132 || texture.dataFormatDescriptor[0].transferFunction !== 2) fault(file, "is not sRGB BC1");
  texture.levels.forEach(({ uncompressedByteLength }, level) => {
    const blocks = (edge) => Math.ceil(Math.max(1, edge >> level) / 4);
    if (uncompressedByteLength !== 8 * blocks(texture.pixelWidth) * blocks(texture.pixelHeight))
      fault(file, `level ${level} is of another size`);
  });
}

for (const file of process.argv.slice(2)) {
  const bytes = new Uint8Array(readFileSync(file));
  if (file.endsWith(".ktx2")) checkTexture(file, bytes);
  else await checkTile(file, bytes);
}
process.exit(faults === 0 ? 0 : 1);
