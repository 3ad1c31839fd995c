import '#kit/style.css';
import './style.css';
import { App } from './app';
import { element, input } from '#kit/overlay';
import { fromFileList, fromHandle, openFolder, WebSource, type Source } from './source';
import { trouble } from './troubles';

// Which dive: the one of the address (?dive=URL), the one that `fathom-topside view` serves, or a folder that is opened here.

let app: App | null = null;

async function open(source: Promise<Source> | Source, images?: string | null): Promise<void> {
  element('opener').hidden = true;
  element('waiting').hidden = false;
  try {
    const opened = await source;
    if (app) throw new Error('a dive is open already: reload the page to open another');
    const next = new App();
    await next.open(opened, images);
    app = next;
    Object.assign(window, { fathom: app });
  } catch (error) {
    trouble(error instanceof Error ? error.message : String(error));
    element('waiting').hidden = true;
    element('opener').hidden = app !== null;
  }
}

async function begin(): Promise<void> {
  const dive = new URLSearchParams(location.search).get('dive');
  if (dive) return open(new WebSource(dive));
  const served = await fetch('view.json').then((r) => (r.ok ? (r.json() as Promise<{ dive: string; images: string | null; name: string }>) : null)).catch(() => null);
  if (served) return open(new WebSource(served.dive, served.name), served.images && new URL(served.images, location.href).href);
  element('waiting').hidden = true;
  element('opener').hidden = false;
}

type Picker = { showDirectoryPicker?: () => Promise<FileSystemDirectoryHandle> };
element('open-folder').onclick = async () => {
  const pick = (window as Picker).showDirectoryPicker;
  if (!pick) return input('folder-input').click();
  const handle = await pick.call(window).catch(() => null);
  if (handle) void open(openFolder(handle.name, fromHandle(handle)));
};
input('folder-input').onchange = () => {
  const files = [...(input('folder-input').files ?? [])];
  if (files.length > 0) void open(openFolder(files[0]!.webkitRelativePath.split('/')[0]!, fromFileList(files)));
};

// A dropped folder is a dive; dropped files go beside the dive that is open.
type Dropped = DataTransferItem & { getAsFileSystemHandle?: () => Promise<FileSystemHandle | null> };
window.addEventListener('dragover', (e) => {
  e.preventDefault();
  element('drop').hidden = false;
});
window.addEventListener('dragleave', (e) => { if (e.relatedTarget === null) element('drop').hidden = true; });
window.addEventListener('drop', (e) => {
  e.preventDefault();
  element('drop').hidden = true;
  const files = [...(e.dataTransfer?.files ?? [])];
  const handles = [...(e.dataTransfer?.items ?? [])].map((item) => (item as Dropped).getAsFileSystemHandle?.());
  void Promise.all(handles).then((found) => {
    const folder = found.find((h): h is FileSystemDirectoryHandle => h?.kind === 'directory');
    if (folder) return open(openFolder(folder.name, fromHandle(folder)));
    if (app) return app.addFiles(files);
    trouble('drop the folder of a dive first');
    return undefined;
  });
});

void begin();
