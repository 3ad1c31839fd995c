// Small helpers for what lies over the picture.

export const element = (id: string): HTMLElement => document.getElementById(id)!;
export const input = (id: string): HTMLInputElement => element(id) as HTMLInputElement;

export function make<K extends keyof HTMLElementTagNameMap>(tag: K, className = '', text = ''): HTMLElementTagNameMap[K] {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text) node.textContent = text;
  return node;
}

export function segments(id: string, choices: [value: string, label: string, title?: string][], choose: (value: string) => void): void {
  for (const [value, label, title] of choices) {
    const button = make('button', '', label);
    button.dataset.value = value;
    if (title) button.title = title;
    button.onclick = () => choose(value);
    element(id).append(button);
  }
}
export function mark(id: string, chosen: string | null): void {
  for (const button of element(id).querySelectorAll('button')) button.setAttribute('aria-pressed', String(button.dataset.value === chosen));
}

export function row(label: string, value: string): HTMLElement {
  const line = make('div', 'row');
  line.append(make('span', '', label), make('b', '', value));
  return line;
}

export function save(name: string, content: Blob | string, type = 'text/plain'): void {
  const link = make('a');
  link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const MOST_TROUBLES = 6;
const troubles: string[] = [];

// One clear line for each thing that is missing or broken; the newest first, and how many more.
export function trouble(what: string): void {
  const line = what.replace(/\s+/g, ' ').slice(0, 220);
  if (troubles.includes(line)) return;
  troubles.unshift(line);
  drawTroubles();
}
export function clearTroubles(): void {
  troubles.length = 0;
  drawTroubles();
}
function drawTroubles(): void {
  const box = element('troubles');
  box.hidden = troubles.length === 0;
  document.body.dataset.troubles = String(troubles.length);
  const close = make('button', '', '×');
  close.title = 'Close';
  close.onclick = clearTroubles;
  const list = make('div');
  for (const line of troubles.slice(0, MOST_TROUBLES)) list.append(make('div', '', line));
  if (troubles.length > MOST_TROUBLES) list.append(make('div', 'fine', `and ${troubles.length - MOST_TROUBLES} more`));
  box.replaceChildren(list, close);
}
