import type { Design, History, Pin } from "./design";

/** What the browser keeps of the bench; the design itself lies in the address too. */
interface Kept {
  design: Design;
  past: Design[];
  future: Design[];
  pins: Pin[];
  hidden: string[];
}

const KEY = "omnimirror-bench";
const LONGEST = 6000; // of a design in the address; longer ones are only kept

/** What was kept, if anything was. */
export function kept(): Kept | null {
  try {
    return JSON.parse(localStorage.getItem(KEY) ?? "null") as Kept | null;
  } catch {
    return null;
  }
}

export function keep(history: History, pins: Pin[], hidden: string[]): void {
  try {
    const all: Kept = { design: history.now, ...history.kept(), pins, hidden };
    localStorage.setItem(KEY, JSON.stringify(all));
  } catch {
    return; // private windows keep nothing, full ones no more
  }
}

/** The design as the address holds it; "" where it is too long. */
export function inAddress(design: Design): string {
  const text = JSON.stringify(design);
  return text.length > LONGEST ? "" : text;
}

export function fromAddress(text: string): Design | null {
  try {
    const found = JSON.parse(text) as Partial<Design>;
    if (typeof found.tables !== "object" || found.tables === null) return null;
    return { tables: found.tables, follows: found.follows === true, distance: found.distance ?? null, wanted: found.wanted ?? null };
  } catch {
    return null;
  }
}
