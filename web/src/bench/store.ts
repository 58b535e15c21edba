import type { Design, History, Pin, Tables } from "./design";
import type { BenchStart } from "./messages";
import { designOf, lacking } from "./whole";

/** What the browser keeps of the bench; the design itself lies in the address too. */
interface Kept {
  design: Design | null;
  past: Design[];
  future: Design[];
  pins: Pin[];
  hidden: string[];
}

const KEY = "omnimirror-bench";
const LONGEST = 6000; // of a design in the address; longer ones are only kept

/** What this tab kept, or else the last tab that kept anything; what of it is no design is left out. */
export function kept(parts: BenchStart): Kept | null {
  for (const storage of [() => sessionStorage, () => localStorage]) {
    try {
      const found = JSON.parse(storage().getItem(KEY) ?? "null") as Partial<Kept> | null;
      if (found) return whole(found, parts);
    } catch {
      continue; // private windows keep nothing
    }
  }
  return null;
}

function whole(found: Partial<Kept>, parts: BenchStart): Kept {
  const isWhole = (design: unknown): boolean => lacking(design, parts) === null;
  const list = <T>(value: T[] | undefined): T[] => (Array.isArray(value) ? value : []);
  const [past, future] = [list(found.past), list(found.future)];
  const isGood = [...past, ...future].every(isWhole);
  return {
    design: isWhole(found.design) ? designOf(found.design as Tables) : null,
    past: isGood ? past : [],
    future: isGood ? future : [],
    pins: list(found.pins).filter((p) => typeof p?.name === "string" && isWhole(p.design)),
    hidden: list(found.hidden).filter((group) => typeof group === "string"),
  };
}

/** Keep all of it for this tab, and for the next one that is opened. */
export function keep(history: History, pins: Pin[], hidden: string[]): void {
  const all: Kept = { design: history.now, ...history.kept(), pins, hidden };
  const text = JSON.stringify(all);
  for (const storage of [() => sessionStorage, () => localStorage]) {
    try {
      storage().setItem(KEY, text);
    } catch {
      continue; // private windows keep nothing, full ones no more
    }
  }
}

/** The design as the address holds it; "" where it is too long. */
export function inAddress(design: Design): string {
  const text = JSON.stringify(design);
  return text.length > LONGEST ? "" : text;
}

/** The design of an address, or what it lacks, in a sentence. */
export function fromAddress(text: string, parts: BenchStart): Design | string {
  let found: unknown;
  try {
    found = JSON.parse(text);
  } catch {
    return "The design of the address cannot be read: it is cut off or changed.";
  }
  const missing = lacking(found, parts);
  return missing === null ? designOf(found as Tables) : `The design of the address is not whole: ${missing}.`;
}
