import type { Table } from './csv';

// Labels of images (habitat classes and the like), joined to the dive's images by file name.

export interface Labels {
  column: string; // where the class was read
  classes: { name: string; images: number }[]; // most frequent first
  ofImage: Int32Array; // class of each image, -1 without
  unknown: number; // rows that name no image of this dive
}

const IMAGE_COLUMNS = /^(image|img|file|filename|file_name|image_name|left|left_image|name|key|point\.media\.key)$/i;
const CLASS_COLUMNS = /^(class|label|habitat|habitat_class|category|cluster|annotation|label\.name|tag)$/i;

// Annotation tools write names with or without folder and ending, and of the raw, the rectified or the right image.
export function stem(name: string): string {
  return name.replace(/^.*[/\\]/, '').replace(/\.[A-Za-z0-9]{1,5}$/, '').replace(/_(LC16|RM16|LC08|RM08|LC|RM)$/i, '').toLowerCase();
}

// Throws an Error whose text says what the file lacks.
export function joinLabels(table: Table, images: { left: string; right?: string }[]): Labels {
  const byName = new Map<string, number>();
  images.forEach((image, i) => {
    if (image.right) byName.set(stem(image.right), i);
    byName.set(stem(image.left), i);
  });
  const known = (column: number): number => table.rows.reduce((n, row) => n + (byName.has(stem(row[column] ?? '')) ? 1 : 0), 0);
  let key = table.columns.findIndex((name, i) => IMAGE_COLUMNS.test(name) && known(i) > 0);
  if (key < 0) key = table.columns.findIndex((_, i) => known(i) > 0);
  if (key < 0) throw new Error('no column names images of this dive');
  let value = table.columns.findIndex((name, i) => i !== key && CLASS_COLUMNS.test(name));
  if (value < 0) value = table.columns.findIndex((_, i) => i !== key && table.rows.some((row) => row[i] && !Number.isFinite(Number(row[i]))));
  if (value < 0) value = table.columns.findIndex((_, i) => i !== key);
  if (value < 0) throw new Error('no column holds a class');

  const counts = new Map<string, number>();
  const names: (string | null)[] = images.map(() => null);
  let unknown = 0;
  for (const row of table.rows) {
    const image = byName.get(stem(row[key] ?? ''));
    const name = row[value] ?? '';
    if (image === undefined) ++unknown;
    else if (name !== '') {
      const old = names[image];
      if (old) counts.set(old, counts.get(old)! - 1);
      names[image] = name;
      counts.set(name, (counts.get(name) ?? 0) + 1);
    }
  }
  const classes = [...counts].filter(([, n]) => n > 0).map(([name, n]) => ({ name, images: n }));
  classes.sort((a, b) => b.images - a.images || a.name.localeCompare(b.name));
  const index = new Map(classes.map((c, i) => [c.name, i]));
  return {
    column: table.columns[value]!, classes, unknown,
    ofImage: Int32Array.from(names, (name) => (name === null ? -1 : index.get(name)!)),
  };
}
