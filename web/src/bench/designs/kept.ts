import type { BenchStart } from "../../shared/messages";
import { locals, parsed, put, sessions, taken } from "../../shared/storage";
import type { Design, History, Pin, Tables } from "./design";
import { designOf, lacking } from "./whole";

/** Browser storage of the bench; the design itself is also in the address. */
interface Kept {
  design: Design | null;
  past: Design[];
  future: Design[];
  pins: Pin[];
  switched: string[];
}

const KEY = "omnimirror-bench";

/** Return the stored state of this tab, or of the last tab; invalid parts are omitted. */
export function kept(parts: BenchStart): Kept | null {
  for (const shelf of [sessions, locals]) {
    const found = parsed(taken(shelf, KEY) ?? "null") as Partial<Kept> | null | undefined;
    if (found) return whole(found, parts);
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
    switched: list(found.switched).filter((group) => typeof group === "string"),
  };
}

/** Store the state for this tab and for new tabs. */
export function keep(history: History, pins: Pin[], switched: string[]): void {
  const all: Kept = { design: history.now, ...history.kept(), pins, switched };
  put([sessions, locals], KEY, JSON.stringify(all));
}
