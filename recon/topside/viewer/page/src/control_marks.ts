import { readCsv, writeCsv } from './csv';
import { keptAs, type Dive } from './dive';
import { element, input, save } from '#kit/overlay';

// Where surveyed points are in the images: marks.csv of a control folder (recon/topside/README.md). They stay in this browser for
// the dive, in all its tabs.

export interface ControlMark {
  point: string;
  image: string;
  u: number;
  v: number; // [px], the centre of the top left pixel is 0
}

export const marksCsv = (list: ControlMark[]): string =>
  writeCsv([['point', 'image', 'u', 'v'], ...list.map((m) => [m.point, m.image, m.u.toFixed(2), m.v.toFixed(2)])]);

// Throws an Error whose text says what the file lacks.
export function readMarks(text: string): ControlMark[] {
  const { columns, rows } = readCsv(text);
  const at = ['point', 'image', 'u', 'v'].map((name) => columns.indexOf(name));
  if (at.includes(-1)) throw new Error('has no columns point, image, u and v');
  const [point, image, u, v] = at as [number, number, number, number];
  const pixel = (text = ''): number => (text === '' ? NaN : Number(text));
  const out = rows.map((row) => ({ point: row[point] ?? '', image: row[image] ?? '', u: pixel(row[u]), v: pixel(row[v]) }));
  return out.filter((m) => m.point !== '' && m.image !== '' && Number.isFinite(m.u + m.v));
}

// A point has one mark in an image: the latest.
export function withMark(list: ControlMark[], mark: ControlMark): ControlMark[] {
  return [...list.filter((m) => m.point !== mark.point || m.image !== mark.image), mark];
}

export class ControlMarks {
  list: ControlMark[] = [];
  onChange: () => void = () => undefined;
  private readonly key: string;

  constructor(dive: Dive, private complain: (what: string) => void) {
    this.key = keptAs(dive.scene, 'control marks');
    this.take(localStorage.getItem(this.key));
    window.addEventListener('storage', (e) => {
      if (e.key === this.key) this.take(e.newValue);
    });
    element('export-marks').onclick = () => save('marks.csv', marksCsv(this.list), 'text/csv');
    element('import-marks').onclick = () => input('marks-input').click();
    input('marks-input').onchange = async () => {
      for (const file of input('marks-input').files ?? []) {
        try {
          this.change(readMarks(await file.text()).reduce(withMark, this.list));
        } catch (error) {
          this.complain(`${file.name} ${(error as Error).message}`);
        }
      }
      input('marks-input').value = '';
    };
  }

  of(image: string): ControlMark[] {
    return this.list.filter((m) => m.image === image);
  }
  set(mark: ControlMark): void {
    this.change(withMark(this.list, mark));
  }
  remove(point: string, image: string): void {
    this.change(this.list.filter((m) => m.point !== point || m.image !== image));
  }

  private take(kept: string | null): void {
    try {
      this.list = readMarks(kept ?? 'point,image,u,v');
    } catch {
      this.list = [];
    }
    this.tell();
  }
  private change(list: ControlMark[]): void {
    this.list = list;
    try {
      localStorage.setItem(this.key, marksCsv(list));
    } catch {
      this.complain('this browser keeps no marks: save marks.csv before you leave');
    }
    this.tell();
  }
  private tell(): void {
    const points = new Set(this.list.map((m) => m.point)).size;
    element('marks-text').textContent = this.list.length === 0 ? 'Open an image of a surveyed point, write its name there, and click its centre.'
      : `${this.list.length} mark${this.list.length > 1 ? 's' : ''} of ${points} point${points > 1 ? 's' : ''}`;
    document.body.dataset.marks = String(this.list.length);
    this.onChange();
  }
}
