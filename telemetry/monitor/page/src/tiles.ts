// Binary form of /api/tiles, little-endian: "FTIL", u32 map version, u32 count, then for each tile i32 north index,
// i32 east index, i16 level, u8 stride, u8 colour bits, f32 size [m], u32 revision, f32 sigma [m], f64 received
// [s UTC]; side * side depths f32 [m] (NaN: not seen), row by row northwards; side * side colours of three bytes,
// padded to four. side = 16 / stride + 1.

export const CELLS = 16;

export interface Tile {
  key: string;
  level: number;
  northIndex: number;
  eastIndex: number;
  stride: number;
  colourBits: number;
  size: number; // edge [m]
  sigma: number; // [m]
  receivedUtc: number; // [s]
  side: number; // nodes per side
  depths: Float32Array; // [m], NaN: not seen
  colours: Uint8Array; // r g b a node
}

export interface TileBatch {
  version: number;
  tiles: Tile[];
}

const HEAD_BYTES = 12;
const TILE_HEAD_BYTES = 32;

export const tileKey = (level: number, north: number, east: number): string => `${level}/${north}/${east}`;

export function decodeTiles(buffer: ArrayBuffer): TileBatch {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEAD_BYTES || view.getUint32(0, true) !== 0x4c495446) throw new Error('not a tile batch');
  const version = view.getUint32(4, true);
  const count = view.getUint32(8, true);
  const tiles: Tile[] = [];
  let at = HEAD_BYTES;
  for (let n = 0; n < count; ++n) {
    if (at + TILE_HEAD_BYTES > buffer.byteLength) throw new Error('tile batch is cut short');
    const northIndex = view.getInt32(at, true);
    const eastIndex = view.getInt32(at + 4, true);
    const level = view.getInt16(at + 8, true);
    const stride = view.getUint8(at + 10);
    if (![1, 2, 4, 8].includes(stride)) throw new Error(`stride ${stride}`);
    const side = CELLS / stride + 1;
    const nodes = side * side;
    const colourBytes = nodes * 3;
    const body = at + TILE_HEAD_BYTES;
    const end = body + nodes * 4 + Math.ceil(colourBytes / 4) * 4;
    if (end > buffer.byteLength) throw new Error('tile batch is cut short');
    tiles.push({
      key: tileKey(level, northIndex, eastIndex),
      level,
      northIndex,
      eastIndex,
      stride,
      colourBits: view.getUint8(at + 11),
      size: view.getFloat32(at + 12, true),
      sigma: view.getFloat32(at + 20, true),
      receivedUtc: view.getFloat64(at + 24, true),
      side,
      depths: new Float32Array(buffer.slice(body, body + nodes * 4)),
      colours: new Uint8Array(buffer.slice(body + nodes * 4, body + nodes * 4 + colourBytes)),
    });
    at = end;
  }
  return { version, tiles };
}

// Two triangles a cell whose four nodes are seen, one where three are; counter-clockwise seen from above.
export function tileTriangles(tile: Tile): number[] {
  const { side, depths } = tile;
  const triangles: number[] = [];
  const seen = (n: number): boolean => !Number.isNaN(depths[n]);
  const add = (a: number, b: number, c: number): void => {
    if (seen(a) && seen(b) && seen(c)) triangles.push(a, b, c);
  };
  for (let i = 0; i + 1 < side; ++i) {
    for (let j = 0; j + 1 < side; ++j) {
      const sw = i * side + j;
      const nw = sw + side;
      if (seen(sw) && seen(nw + 1)) {
        add(sw, sw + 1, nw + 1);
        add(sw, nw + 1, nw);
      } else {
        add(sw, sw + 1, nw);
        add(sw + 1, nw + 1, nw);
      }
    }
  }
  return triangles;
}
