import { fromBlob, fromUrl, type GeoTIFF } from 'geotiff';

// Where a dive's files are read from: a web server, or a folder that the user opened in the browser. In both cases the
// files have addresses, so that relative names in them mean the same.

export interface Source {
  readonly name: string;
  readonly base: string; // address of the folder that holds scene.json, with a slash at the end
  fetch(address: string, options?: RequestInit): Promise<Response>;
  tiff(address: string): Promise<GeoTIFF>;
  blob(address: string): Promise<Blob>;
}

export class Missing extends Error {}

async function blobOf(source: Source, address: string): Promise<Blob> {
  const answer = await source.fetch(address);
  if (!answer.ok) throw new Missing(`${fileName(address)} is missing (${answer.status})`);
  return answer.blob();
}

export const fileName = (address: string): string => decodeURIComponent(address.replace(/[?#].*$/, '').replace(/^.*\//, ''));

export class WebSource implements Source {
  readonly base: string;
  constructor(address: string, readonly name = address) {
    const url = new URL(address.replace(/scene\.json$/, ''), location.href);
    if (!url.pathname.endsWith('/')) url.pathname += '/';
    this.base = url.href;
  }
  fetch(address: string, options?: RequestInit): Promise<Response> {
    return fetch(address, options);
  }
  tiff(address: string): Promise<GeoTIFF> {
    return fromUrl(address, { allowFullFile: true });
  }
  blob(address: string): Promise<Blob> {
    return blobOf(this, address);
  }
}

// Reads one file of an opened folder, or null; `path` is relative to the folder, with slashes.
export type FileFinder = (path: string) => Promise<File | null>;

const FOLDER_HOST = 'http://folder.invalid/';

export class FolderSource implements Source {
  readonly base: string;
  constructor(readonly name: string, private find: FileFinder, within: string) {
    this.base = FOLDER_HOST + within;
  }
  private file(address: string): Promise<File | null> {
    return this.find(decodeURIComponent(new URL(address).pathname.slice(1)));
  }
  async fetch(address: string): Promise<Response> {
    if (!address.startsWith(FOLDER_HOST)) return fetch(address);
    const file = await this.file(address);
    return file ? new Response(file) : new Response(null, { status: 404, statusText: 'not in the opened folder' });
  }
  async tiff(address: string): Promise<GeoTIFF> {
    return fromBlob(await this.blob(address));
  }
  async blob(address: string): Promise<Blob> {
    const file = await this.file(address);
    if (!file) throw new Missing(`${fileName(address)} is not in the opened folder`);
    return file;
  }
}

export function fromFileList(files: Iterable<File>): FileFinder {
  const byPath = new Map<string, File>();
  for (const file of files) byPath.set(file.webkitRelativePath.replace(/^[^/]*\//, '') || file.name, file);
  return async (path) => byPath.get(path) ?? null;
}

// A mission's folder may hold hundreds of thousands of images: handles look files up one by one.
export function fromHandle(root: FileSystemDirectoryHandle): FileFinder {
  return async (path) => {
    const parts = path.split('/').filter((part) => part !== '');
    const name = parts.pop();
    if (!name) return null;
    try {
      let folder = root;
      for (const part of parts) folder = await folder.getDirectoryHandle(part);
      return await (await folder.getFileHandle(name)).getFile();
    } catch {
      return null;
    }
  };
}

// The folder opened may be the output itself or the mission that holds it.
const PLACES_OF_SCENE = ['', 'topside/', 'output/', 'out/'];

export async function openFolder(name: string, find: FileFinder): Promise<FolderSource> {
  for (const within of PLACES_OF_SCENE) if (await find(`${within}scene.json`)) return new FolderSource(name, find, within);
  throw new Missing(`${name} holds no scene.json: open an output folder of fathom-topside, or the mission folder around it`);
}
