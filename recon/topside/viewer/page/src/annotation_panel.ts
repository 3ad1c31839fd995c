import { merge, readAnnotations, seenBy, toCsv, toGeoJson, type Annotation } from './annotations';
import { keptAs, type Dive } from './dive';
import { number } from '#kit/format';
import type { Marks } from './marks';
import { element, input, make, save } from '#kit/overlay';
import { toScene, type Place } from '#kit/place';
import type { View } from './view';

// The list of annotations; it stays in this browser for the dive, and goes out and comes in as GeoJSON or CSV.

export class AnnotationPanel {
  list: Annotation[] = [];
  private lastClass = '';
  private readonly key: string;

  constructor(private dive: Dive, private view: View, private marks: Marks, private complain: (what: string) => void) {
    const byName = keptAs({ ...dive.scene, id: '' }, 'annotations');
    this.key = keptAs(dive.scene, 'annotations');
    const kept = localStorage.getItem(this.key);
    // Those that a browser kept by the dive's name, which others may have, are this dive's if its images saw them.
    this.list = kept !== null ? this.parse(kept) : seenBy(dive.images.map((i) => i.left), this.parse(localStorage.getItem(byName)));
    window.addEventListener('storage', (e) => {
      if (e.key === this.key && e.newValue !== null) this.take(this.parse(e.newValue));
    });
    const file = (dive.scene.name || dive.scene.dive_id || 'dive').replace(/[^\w.-]+/g, '_');
    element('export-geojson').onclick = () => save(`${file}_annotations.geojson`, toGeoJson(this.list, dive.projection, dive.scene.dive_id), 'application/geo+json');
    element('export-csv').onclick = () => save(`${file}_annotations.csv`, toCsv(this.list, dive.projection, dive.scene.dive_id), 'text/csv');
    element('import-annotations').onclick = () => input('annotations-input').click();
    input('annotations-input').onchange = async () => {
      for (const f of input('annotations-input').files ?? []) await this.read(f);
      input('annotations-input').value = '';
    };
    this.draw();
  }

  private parse(kept: string | null): Annotation[] {
    try {
      return readAnnotations(kept ?? '', this.dive.projection);
    } catch {
      return []; // none kept
    }
  }
  // As another tab with the same dive has them; what is being typed here stays under the hand.
  private take(list: Annotation[]): void {
    const have = new Map(this.list.map((a) => [a.id, a]));
    this.list = list.map((a) => Object.assign(have.get(a.id) ?? a, a));
    const typed = element('annotations').querySelector(':focus');
    if (typed instanceof HTMLInputElement) typed.addEventListener('blur', () => this.draw(), { once: true });
    else this.draw();
  }

  async read(file: File): Promise<void> {
    try {
      this.list = merge(this.list, readAnnotations(await file.text(), this.dive.projection));
      this.changed();
    } catch (error) {
      this.complain(`${file.name} ${(error as Error).message}`);
    }
  }

  add(place: Place, images: string[]): void {
    const utc = new Date().toISOString();
    this.list.push({ id: `${utc.replace(/\D/g, '')}-${this.list.length + 1}`, class: this.lastClass, note: '', utc, ...place, images });
    this.changed();
    element('annotations').querySelector<HTMLInputElement>('.annotation:last-child .class')?.focus();
  }

  private changed(): void {
    this.draw();
    this.keep();
  }
  private keep(): void {
    try {
      localStorage.setItem(this.key, toGeoJson(this.list, this.dive.projection, this.dive.scene.dive_id));
    } catch {
      this.complain('this browser keeps no annotations: export them before you leave');
    }
  }

  private draw(): void {
    const classes = make('datalist');
    classes.id = 'annotation-classes';
    for (const name of new Set(this.list.map((a) => a.class).filter((c) => c !== ''))) classes.append(new Option(name));
    element('annotations').replaceChildren(classes, ...this.list.map((a) => this.entry(a)));
    if (this.list.length === 0) element('annotations').append(make('div', 'fine', 'Choose Annotate and click what to mark.'));
    this.marks.setAnnotations(this.list.map((a) => ({ ...a, depth: Number.isFinite(a.depth) ? a.depth : 0 })));
    document.body.dataset.annotations = String(this.list.length);
    this.view.draw();
  }

  private entry(a: Annotation): HTMLElement {
    const box = make('div', 'annotation');
    const field = (kind: 'class' | 'note', hint: string): HTMLInputElement => {
      const text = make('input', kind);
      text.type = 'text';
      text.placeholder = hint;
      text.value = a[kind];
      if (kind === 'class') text.setAttribute('list', 'annotation-classes');
      text.onchange = () => {
        a[kind] = text.value.trim();
        if (kind === 'class') this.lastClass = a.class;
        this.keep();
      };
      return text;
    };
    const remove = make('button', '', '×');
    remove.title = 'Remove';
    remove.onclick = () => {
      this.list = this.list.filter((other) => other !== a);
      this.changed();
    };
    const where = make('button', 'where', `${number(a.north, 2)} N  ${number(a.east, 2)} E  ${number(a.depth, 2, 'm deep')}`);
    where.title = 'Fly there';
    where.style.textAlign = 'left';
    where.onclick = () => this.view.flyAbove(toScene({ ...a, depth: Number.isFinite(a.depth) ? a.depth : 0 }), 2.5);
    box.append(field('class', 'Class'), remove, field('note', 'Note'), where);
    return box;
  }
}
