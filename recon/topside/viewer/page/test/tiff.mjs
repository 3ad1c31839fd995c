// A plain TIFF writer: one image, uncompressed, one strip, samples of 8 or 16 bit or float; with GeoTIFF tags if asked.
const TYPE = { ascii: 2, short: 3, long: 4, double: 12 };
const SIZE = { 2: 1, 3: 2, 4: 4, 12: 8 };

// `samples`: Uint8Array, Uint16Array or Float32Array, interleaved. `geo`: { scale, north, west, keys, noData }.
export function writeTiff(samples, width, height, bands = 1, geo = null) {
  const tags = [];
  const tag = (id, type, values) => tags.push({ id, type, values });
  tag(256, TYPE.long, [width]);
  tag(257, TYPE.long, [height]);
  tag(258, TYPE.short, new Array(bands).fill(samples.BYTES_PER_ELEMENT * 8));
  tag(259, TYPE.short, [1]);
  tag(262, TYPE.short, [bands >= 3 ? 2 : 1]);
  tag(273, TYPE.long, [0]);
  tag(277, TYPE.short, [bands]);
  tag(278, TYPE.long, [height]);
  tag(279, TYPE.long, [samples.byteLength]);
  tag(284, TYPE.short, [1]);
  if (bands === 4) tag(338, TYPE.short, [2]);
  tag(339, TYPE.short, new Array(bands).fill(samples instanceof Float32Array ? 3 : 1));
  if (geo) {
    const doubles = [];
    const keys = [];
    for (const [id, value, isDouble] of geo.keys) {
      keys.push(...(isDouble ? [id, 34736, 1, doubles.length] : [id, 0, 1, value]));
      if (isDouble) doubles.push(value);
    }
    tag(33550, TYPE.double, [geo.scale, geo.scale, 0]);
    tag(33922, TYPE.double, [0, 0, 0, geo.west, geo.north, 0]);
    tag(34735, TYPE.short, [1, 1, 0, geo.keys.length, ...keys]);
    if (doubles.length > 0) tag(34736, TYPE.double, doubles);
    if (geo.noData !== undefined) tag(42113, TYPE.ascii, [...`${geo.noData}\0`].map((c) => c.charCodeAt(0)));
  }
  const table = 8;
  let end = Math.ceil((table + 2 + 12 * tags.length + 4) / 8) * 8;
  const places = tags.map(({ type, values }) => {
    const bytes = SIZE[type] * values.length;
    if (bytes <= 4) return 0;
    const at = end;
    end += Math.ceil(bytes / 8) * 8;
    return at;
  });
  const buffer = Buffer.alloc(end + samples.byteLength);
  tags.find((t) => t.id === 273).values = [end];
  buffer.write('II', 0);
  buffer.writeUInt16LE(42, 2);
  buffer.writeUInt32LE(table, 4);
  buffer.writeUInt16LE(tags.length, table);
  const put = { 2: 'writeUInt8', 3: 'writeUInt16LE', 4: 'writeUInt32LE', 12: 'writeDoubleLE' };
  tags.forEach(({ id, type, values }, i) => {
    const at = table + 2 + 12 * i;
    buffer.writeUInt16LE(id, at);
    buffer.writeUInt16LE(type, at + 2);
    buffer.writeUInt32LE(values.length, at + 4);
    if (places[i]) buffer.writeUInt32LE(places[i], at + 8);
    values.forEach((v, k) => buffer[put[type]](v, (places[i] || at + 8) + k * SIZE[type]));
  });
  Buffer.from(samples.buffer, samples.byteOffset, samples.byteLength).copy(buffer, end);
  return buffer;
}

// Keys of a transverse Mercator about an origin, scale 1: as the nav frame has it.
export const localKeys = (latitude, longitude) => [
  [1024, 1], [1025, 1], [2048, 4326], [3072, 32767], [3074, 32767], [3075, 1], [3076, 9001],
  [3080, longitude, true], [3081, latitude, true], [3082, 0, true], [3083, 0, true], [3092, 1, true],
];
