// Binary form of /api/map: the map in squares of 16 m, ready for the graphics card. The layout is described where it is
// written, in telemetry/monitor/map/received_map.hpp.

export const CHUNK_SIZE = 16; // [m]
const UNITS_PER_METRE = 128;
const HEAD_BYTES = 24;
const CHUNK_HEAD_BYTES = 24;
const BYTES_PER_VERTEX = 28;
const NARROW_INDICES = 65535;

export interface Chunk {
  key: string;
  north: number; // of the south-west corner [m]
  east: number;
  area: number; // [m2]
  vertices: number;
  triangles: number;
  places: Uint16Array; // north, east [1/128 m]
  depths: Float32Array; // [m]
  normals: Int8Array; // north, east, up (127: 1), spacing code
  colours: Uint8Array; // red, green, blue, flags
  bounds: Uint16Array; // sigma, error bound [mm]
  times: Float32Array; // received, changed [s since base]; changed: NaN for never
  indices: Uint16Array | Uint32Array;
}

export interface ChunkBatch {
  version: number; // the reader has everything up to this map version now
  baseUtc: number; // [s]
  chunks: Chunk[];
}

export const HAS_COLOUR = 1;
export const INTERPOLATED = 2;

export const spacingOf = (code: number): number => 2 ** (code - 7); // [m]

export function decodeChunks(buffer: ArrayBuffer): ChunkBatch {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEAD_BYTES || view.getUint32(0, true) !== 0x50414d46) throw new Error('not a map batch');
  const count = view.getUint32(8, true);
  const chunks: Chunk[] = [];
  let at = HEAD_BYTES;
  for (let n = 0; n < count; ++n) {
    if (at + CHUNK_HEAD_BYTES > buffer.byteLength) throw new Error('map batch is cut short');
    const vertices = view.getUint32(at + 8, true);
    const triangles = view.getUint32(at + 12, true);
    const wide = vertices > NARROW_INDICES;
    const body = at + CHUNK_HEAD_BYTES;
    const indexAt = body + vertices * BYTES_PER_VERTEX;
    const end = indexAt + Math.ceil((triangles * 3 * (wide ? 4 : 2)) / 4) * 4;
    if (end > buffer.byteLength) throw new Error('map batch is cut short');
    // Copies, so that a small chunk does not hold the memory of its whole batch.
    const part = (from: number, bytes: number): ArrayBuffer =>
      buffer.slice(body + from * vertices, body + from * vertices + bytes * vertices);
    const north = view.getInt32(at, true);
    const east = view.getInt32(at + 4, true);
    const indices = buffer.slice(indexAt, indexAt + triangles * 3 * (wide ? 4 : 2));
    chunks.push({
      key: `${north}/${east}`,
      north: north * CHUNK_SIZE,
      east: east * CHUNK_SIZE,
      area: view.getFloat32(at + 16, true),
      vertices,
      triangles,
      places: new Uint16Array(part(0, 4)),
      depths: new Float32Array(part(4, 4)),
      normals: new Int8Array(part(8, 4)),
      colours: new Uint8Array(part(12, 4)),
      bounds: new Uint16Array(part(16, 4)),
      times: new Float32Array(part(20, 8)),
      indices: wide ? new Uint32Array(indices) : new Uint16Array(indices),
    });
    at = end;
  }
  return { version: view.getUint32(4, true), baseUtc: view.getFloat64(16, true), chunks };
}

// Vertices in the scene relative to the chunk's south-west corner and a depth: x east, y up, z south [m].
export function positionsOf(chunk: Chunk, originDepth: number): Float32Array {
  const out = new Float32Array(chunk.vertices * 3);
  for (let v = 0; v < chunk.vertices; ++v) {
    out[3 * v] = chunk.places[2 * v + 1]! / UNITS_PER_METRE;
    out[3 * v + 1] = originDepth - chunk.depths[v]!;
    out[3 * v + 2] = -chunk.places[2 * v]! / UNITS_PER_METRE;
  }
  return out;
}

// Binary form of /api/coverage: "FCOV", u32 count, then for each square i32 north, i32 east [m], f32 depth [m].
export interface Square {
  north: number;
  east: number;
  depth: number;
}

export function decodeSquares(buffer: ArrayBuffer): Square[] {
  const view = new DataView(buffer);
  if (buffer.byteLength < 8 || view.getUint32(0, true) !== 0x564f4346) throw new Error('not a coverage');
  const count = view.getUint32(4, true);
  if (buffer.byteLength !== 8 + 12 * count) throw new Error('coverage is cut short');
  return Array.from({ length: count }, (_, n) => ({
    north: view.getInt32(8 + 12 * n, true),
    east: view.getInt32(12 + 12 * n, true),
    depth: view.getFloat32(16 + 12 * n, true),
  }));
}
