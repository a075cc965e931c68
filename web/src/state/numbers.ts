// Numbers as they are typed: text, and what is wrong with it.

/** Text that is no number, by the name of its field in the form and its path in the request. */
export class InvalidDraft extends Error {
  constructor(
    readonly field: string,
    readonly text: string,
    readonly path = "",
  ) {
    super(`${field}: ${faultOf(text)}`);
  }
}

/** What is wrong with a text that is no number. */
function faultOf(text: string): string {
  return text.trim() === "" ? "a number is needed" : `${JSON.stringify(text)} is not a number`;
}

/** Whether a text reads as a number, or as none yet. */
export function isNumber(text: string): boolean {
  return Number.isFinite(Number(text.trim().replace(",", ".")));
}

export function numberOf(text: string, field: string, path = ""): number {
  if (text.trim() === "" || !isNumber(text)) throw new InvalidDraft(field, text, path);
  return Number(text.trim().replace(",", "."));
}

export function numbersOf(texts: readonly string[], field: string, path = ""): number[] {
  return texts.map((text, i) => numberOf(text, `${field} ${i + 1}`, `${path}[${i}]`));
}

export function optional(text: string, field: string, path: string): number | undefined {
  return text.trim() === "" ? undefined : numberOf(text, field, path);
}

export function defined<T extends object>(fields: T): T {
  return Object.fromEntries(Object.entries(fields).filter(([, value]) => value !== undefined)) as T;
}

export const texts = (values: readonly number[]): string[] => values.map(String);

/** Returns a number as text; empty where there is none. */
export const textOf = (value: unknown): string => (value === null || value === undefined ? "" : String(value));

/** Returns a time to the millisecond [s]. */
export const rounded = (time_s: number): number => Number(time_s.toFixed(3));

export function vector(values: readonly string[]): [number, number, number] | null {
  const [x, y, z] = values.map((value) => (value.trim() === "" ? NaN : Number(value.replace(",", "."))));
  if (x === undefined || y === undefined || z === undefined) return null;
  return [x, y, z].every(Number.isFinite) ? [x, y, z] : null;
}
