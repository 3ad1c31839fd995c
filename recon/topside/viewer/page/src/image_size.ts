// Width and height of a JPEG, PNG or WebP from its first bytes, so that it can be decoded at a smaller size at once.

export function imageSize(bytes: Uint8Array): { width: number; height: number; type: string } | null {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const text = (at: number, n: number): string => String.fromCharCode(...bytes.subarray(at, at + n));
  if (bytes.length > 24 && text(1, 3) === 'PNG') return { width: view.getUint32(16), height: view.getUint32(20), type: 'image/png' };
  if (bytes.length > 30 && text(0, 4) === 'RIFF' && text(8, 4) === 'WEBP') {
    const type = 'image/webp';
    switch (text(12, 4)) {
      case 'VP8 ':
        return { width: view.getUint16(26, true) & 0x3fff, height: view.getUint16(28, true) & 0x3fff, type };
      case 'VP8L': {
        const bits = view.getUint32(21, true);
        return { width: (bits & 0x3fff) + 1, height: ((bits >> 14) & 0x3fff) + 1, type };
      }
      case 'VP8X':
        return { width: (view.getUint32(24, true) & 0xffffff) + 1, height: (view.getUint32(27, true) & 0xffffff) + 1, type };
    }
    return null;
  }
  if (bytes.length > 4 && view.getUint16(0) === 0xffd8) {
    let at = 2;
    while (at + 9 < bytes.length && bytes[at] === 0xff) {
      const marker = bytes[at + 1]!;
      const frame = marker >= 0xc0 && marker <= 0xcf && marker !== 0xc4 && marker !== 0xc8 && marker !== 0xcc;
      if (frame) return { width: view.getUint16(at + 7), height: view.getUint16(at + 5), type: 'image/jpeg' };
      at += 2 + view.getUint16(at + 2);
    }
  }
  return null;
}
