import '#kit/tokens.css';
import './style.css';
import { element, make } from '#kit/overlay';
import type { Cell, Content, Part } from './content';
import { showPlot } from './plot';

// Shows what the program wrote into the page.

function table(head: string[], rows: Cell[][]): HTMLElement {
  const line = (cells: Cell[], tag: 'td' | 'th'): HTMLElement => {
    const tr = make('tr');
    for (const cell of cells) {
      if (typeof cell === 'string') tr.append(make(tag, '', cell));
      else {
        const box = make(tag, '', cell.text);
        const strength = Math.round(70 * Math.min(Math.abs(cell.shade), 1));
        box.style.background = `color-mix(in srgb, ${cell.shade < 0 ? 'var(--low)' : 'var(--high)'} ${strength}%, transparent)`;
        tr.append(box);
      }
    }
    return tr;
  };
  const box = make('table');
  if (head.length > 0) box.append(line(head, 'th'));
  box.append(...rows.map((row) => line(row, 'td')));
  return box;
}

function figure(caption: string, ...parts: HTMLElement[]): HTMLElement {
  const box = make('figure');
  box.append(...parts, make('figcaption', '', caption));
  return box;
}

function show(part: Part): HTMLElement {
  if ('text' in part) return make('p', part.strong ? 'strong' : '', part.text);
  if ('list' in part) {
    const list = make('ul');
    list.append(...part.list.map((line) => make('li', '', line)));
    return list;
  }
  if ('table' in part) return table(part.table.head ?? [], part.table.rows);
  if ('picture' in part) {
    const picture = make('img');
    picture.src = part.picture.source;
    picture.alt = part.picture.caption;
    return figure(part.picture.caption, picture);
  }
  const { plot } = part;
  const key = make('div', 'key');
  for (const { label, colour } of plot.series.filter((s) => s.label !== '')) {
    const item = make('span', '', label);
    item.style.setProperty('--colour', colour);
    key.append(item);
  }
  const box = make('div', 'plot');
  showPlot(box, plot);
  return figure(plot.title, key, box);
}

const content = JSON.parse(element('content').textContent!) as Content;
document.title = `Fathom: ${content.title}`;
element('report').append(make('h1', '', content.title), make('p', 'about', content.about));
for (const { title, parts } of content.sections) {
  const section = make('section');
  if (title !== '') section.append(make('h2', '', title));
  section.append(...parts.map(show));
  element('report').append(section);
}
