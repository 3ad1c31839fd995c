// Comma, semicolon or tab separated text with quotes (RFC 4180), first line the names of the columns.

export interface Table {
  columns: string[];
  rows: string[][];
}

export function readCsv(text: string): Table {
  const first = text.slice(0, text.search(/[\r\n]|$/));
  const separator = [',', ';', '\t'].sort((a, b) => first.split(b).length - first.split(a).length)[0]!;
  const rows: string[][] = [];
  let row: string[] = [];
  let field = '';
  let quoted = false;
  const endRow = (): void => {
    row.push(field);
    if (row.some((f) => f.trim() !== '')) rows.push(row.map((f) => f.trim()));
    row = [];
    field = '';
  };
  for (let i = text.charCodeAt(0) === 0xfeff ? 1 : 0; i < text.length; ++i) {
    const c = text[i]!;
    if (quoted) {
      if (c !== '"') field += c;
      else if (text[i + 1] === '"') field += text[++i];
      else quoted = false;
    } else if (c === '"') quoted = true;
    else if (c === separator) {
      row.push(field);
      field = '';
    } else if (c === '\n') endRow();
    else if (c !== '\r') field += c;
  }
  if (field !== '' || row.length > 0) endRow();
  const columns = rows.shift() ?? [];
  return { columns, rows };
}

export const writeCsv = (rows: (string | number)[][]): string =>
  rows.map((row) => row.map((f) => (/[",\n\r]/.test(String(f)) ? `"${String(f).replaceAll('"', '""')}"` : String(f))).join(',') + '\n').join('');
