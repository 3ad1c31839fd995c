import { post, type DownlinkState, type SentRequest } from './api';
import { duration, spacingText } from '#kit/format';
import { element, input, make } from '#kit/overlay';
import { areaOf, type Bounds } from '#kit/place';

// What the ship asks of the vehicle: detail in a box, rate, map on or off, a status now.

const LONGEST_SIDE = 819.2; // of a box, as the link can say it [m]

export class Commands {
  box: Bounds | null = null;
  onCleared: () => void = () => undefined;
  private shown = '';

  constructor() {
    element('ask-detail').onclick = () => void this.detail();
    element('drop-box').onclick = () => this.drop();
    element('set-rate').onclick = () => void this.send({ kind: 'rate', rate_bps: Number(input('rate').value) });
    element('pause').onclick = () => void this.send({ kind: 'pause-map' });
    element('resume').onclick = () => void this.send({ kind: 'resume-map' });
    element('send-status').onclick = () => void this.send({ kind: 'send-status' });
  }

  setBox(box: Bounds): void {
    this.box = box;
    element('box-card').hidden = false;
    element('box-size').textContent =
      `${(box.north1 - box.north0).toFixed(1)} × ${(box.east1 - box.east0).toFixed(1)} m, ${areaOf(box).toFixed(0)} m²`;
  }

  drop(): void {
    this.box = null;
    element('box-card').hidden = true;
    this.onCleared();
  }

  private async detail(): Promise<void> {
    const b = this.box;
    if (!b) return;
    if (Math.max(b.north1 - b.north0, b.east1 - b.east0) > LONGEST_SIDE) {
      this.say('The box is too long: 819 m at most', true);
      return;
    }
    const sent = await this.send({
      kind: 'detail',
      north_m: [b.north0, b.north1],
      east_m: [b.east0, b.east1],
      spacing_m: Number((element('detail-spacing') as HTMLSelectElement).value),
      max_error_m: Number((element('detail-error') as HTMLSelectElement).value),
    });
    if (sent) this.drop();
  }

  private async send(body: unknown): Promise<boolean> {
    try {
      await post('api/request', body);
      this.say('', false);
      return true;
    } catch (error) {
      this.say(error instanceof Error ? error.message : String(error), true);
      return false;
    }
  }

  private say(text: string, wrong: boolean): void {
    const line = element('command-answer');
    line.textContent = text;
    line.hidden = text === '';
    line.classList.toggle('wrong', wrong);
  }

  update(downlink: DownlinkState, now: number): void {
    const reason = element('command-reason');
    reason.hidden = downlink.enabled;
    reason.textContent = downlink.reason ?? '';
    for (const field of element('commands').querySelectorAll<HTMLButtonElement | HTMLInputElement | HTMLSelectElement>('button, input, select')) {
      if (field.id === 'drop-box') continue;
      field.disabled = !downlink.enabled;
      field.title = downlink.reason ?? '';
    }
    const rows = downlink.requests.map((r): [SentRequest, string] => [r, `${r.state}${r.state === 'sent' && r.times_sent > 1 ? ` ${r.times_sent} times` : ''} ${duration(now - r.utc_s)} ago`]);
    const text = JSON.stringify(rows);
    if (text === this.shown) return;
    this.shown = text;
    element('requests').replaceChildren(
      ...rows.map(([request, state]) => {
        const row = make('div', `request ${request.state === 'no answer' ? 'unanswered' : request.state}`);
        row.append(make('span', '', request.text), make('em', '', state));
        return row;
      }),
    );
  }
}

export function fillSpacings(): void {
  const select = element('detail-spacing') as HTMLSelectElement;
  for (const spacing of [0.5, 0.25, 0.125, 0.0625, 0.03125]) {
    const option = make('option', '', spacingText(spacing));
    option.value = String(spacing);
    option.selected = spacing === 0.125;
    select.append(option);
  }
}
