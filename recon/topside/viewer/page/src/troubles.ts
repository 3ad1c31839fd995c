import { element, make } from '#kit/overlay';

// One clear line for each thing that is missing or broken; the newest first, and how many more.

const MOST_SHOWN = 6;
const troubles: string[] = [];

export function trouble(what: string): void {
  const line = what.replace(/\s+/g, ' ').slice(0, 220);
  if (troubles.includes(line)) return;
  troubles.unshift(line);
  draw();
}
function draw(): void {
  const box = element('troubles');
  box.hidden = troubles.length === 0;
  document.body.dataset.troubles = String(troubles.length);
  const close = make('button', '', '×');
  close.title = 'Close';
  close.onclick = () => {
    troubles.length = 0;
    draw();
  };
  const list = make('div');
  for (const line of troubles.slice(0, MOST_SHOWN)) list.append(make('div', '', line));
  if (troubles.length > MOST_SHOWN) list.append(make('div', 'fine', `and ${troubles.length - MOST_SHOWN} more`));
  box.replaceChildren(list, close);
}
