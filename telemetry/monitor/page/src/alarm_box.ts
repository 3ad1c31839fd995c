import { AlarmBook, THRESHOLD_LABELS, findAlarms, readThresholds, type Thresholds } from './alarms';
import type { MonitorState } from './api';
import { element, make } from '#kit/overlay';

// The alarms in the panel: what stands, a button to acknowledge it, and the thresholds, which the browser keeps.

const STORED_AS = 'fathom-thresholds';

export class AlarmBox {
  thresholds: Thresholds;
  private book = new AlarmBook();
  private shown = '';

  constructor() {
    this.thresholds = readThresholds(localStorage.getItem(STORED_AS));
    for (const key of Object.keys(THRESHOLD_LABELS) as (keyof Thresholds)[]) {
      const [label, unit] = THRESHOLD_LABELS[key];
      const row = make('label', 'row');
      const field = make('input');
      field.type = 'number';
      field.min = '0';
      field.step = 'any';
      field.value = String(this.thresholds[key]);
      field.onchange = () => {
        const value = Number(field.value);
        if (field.value !== '' && Number.isFinite(value) && value >= 0) this.thresholds[key] = value;
        field.value = String(this.thresholds[key]);
        localStorage.setItem(STORED_AS, JSON.stringify(this.thresholds));
      };
      row.append(make('span', '', label), field, make('em', '', unit));
      element('thresholds').append(row);
    }
  }

  update(state: MonitorState, age: number | null): void {
    this.book.update(findAlarms(state, age, this.thresholds));
    const standing = this.book.standing;
    document.title = `${this.book.open > 0 ? `(${this.book.open}) ` : ''}Fathom monitor`;
    const now = JSON.stringify(standing);
    if (now === this.shown) return; // leaves the buttons where the pointer is
    this.shown = now;
    const list = standing.map((alarm) => {
      const row = make('div', `alarm${alarm.severe ? ' severe' : ''}${alarm.acknowledged ? ' acknowledged' : ''}`);
      row.dataset.alarm = alarm.id;
      row.append(make('span', '', alarm.text));
      if (alarm.acknowledged) row.append(make('em', '', 'seen'));
      else {
        const button = make('button', 'button', 'Acknowledge');
        button.onclick = () => {
          this.book.acknowledge(alarm.id);
          this.update(state, age);
        };
        row.append(button);
      }
      return row;
    });
    element('alarms').replaceChildren(...(list.length > 0 ? list : [make('div', 'fine', 'No alarm')]));
  }
}
