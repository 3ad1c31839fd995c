import type { History } from './api';

// What the chart shows of a history: bit/s and the share of lost frames from the beginning of every step, and once more at
// the end of the last. Loss is a difference of counts in which late and repaired frames go back, so that a step may come out
// below zero: it counts as none.
export function linkSeries(history: History): [times: number[], rates: number[], losses: (number | null)[]] {
  const steps = history.steps.length > 0 ? [...history.steps, history.steps[history.steps.length - 1]!] : [];
  const times = steps.map((_, i) => history.start_utc_s + i * history.step_s);
  const rates = steps.map(([bps]) => bps);
  const losses = steps.map(([, accepted, lost]) => {
    const gone = Math.max(lost, 0);
    return accepted + gone > 0 ? (100 * gone) / (accepted + gone) : null;
  });
  return [times, rates, losses];
}

// Means of groups of steps, so that a chart has no more points than it has pixels to show them.
export function thinned(history: History, most: number): History {
  const group = Math.ceil(history.steps.length / most);
  if (group <= 1) return history;
  const steps: History['steps'] = [];
  for (let i = 0; i < history.steps.length; i += group) {
    const part = history.steps.slice(i, i + group);
    const sum = (k: number): number => part.reduce((total, step) => total + step[k]!, 0);
    steps.push([sum(0) / part.length, sum(1), sum(2), sum(3)]);
  }
  return { start_utc_s: history.start_utc_s, step_s: history.step_s * group, steps };
}
