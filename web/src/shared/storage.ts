/** What browsers keep between loads: of this tab, or of all. Private windows keep nothing, and full ones no more. */
type Shelf = () => Storage;

export const sessions: Shelf = () => sessionStorage;
export const locals: Shelf = () => localStorage;

/** The text under a key; null where there is none. */
export function taken(shelf: Shelf, key: string): string | null {
  try {
    return shelf().getItem(key);
  } catch {
    return null;
  }
}

/** Keep a text under a key, on each shelf that takes it. */
export function put(shelves: Shelf[], key: string, text: string): void {
  for (const shelf of shelves) {
    try {
      shelf().setItem(key, text);
    } catch {
      continue;
    }
  }
}

/** What a JSON text holds; undefined where it is none. */
export function parsed(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return undefined;
  }
}
