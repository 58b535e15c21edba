import type { DesignStart } from "../../shared/messages";
import { locals, parsed, put, sessions, load } from "../../shared/storage";
import type { Design, History, Pin, Tables } from "./design";
import { designOf, lacking } from "./validation";

/** Browser storage of the Design tab; the design itself is also in the address. */
interface Stored {
  design: Design | null;
  past: Design[];
  future: Design[];
  pins: Pin[];
  switched: string[];
}

const KEY = "omnimirror-design";

/** Return the stored state of this tab, or of the last tab; invalid parts are omitted. */
export function stored(parts: DesignStart): Stored | null {
  for (const area of [sessions, locals]) {
    const result = parsed(load(area, KEY) ?? "null") as Partial<Stored> | null | undefined;
    if (result) return whole(result, parts);
  }
  return null;
}

function whole(result: Partial<Stored>, parts: DesignStart): Stored {
  const isWhole = (design: unknown): boolean => lacking(design, parts) === null;
  const list = <T>(value: T[] | undefined): T[] => (Array.isArray(value) ? value : []);
  const [past, future] = [list(result.past), list(result.future)];
  const isGood = [...past, ...future].every(isWhole);
  return {
    design: isWhole(result.design) ? designOf(result.design as Tables) : null,
    past: isGood ? past : [],
    future: isGood ? future : [],
    pins: list(result.pins).filter((p) => typeof p?.name === "string" && isWhole(p.design)),
    switched: list(result.switched).filter((group) => typeof group === "string"),
  };
}

/** Store the state for this tab and for new tabs. */
export function keep(history: History, pins: Pin[], switched: string[]): void {
  const all: Stored = { design: history.now, ...history.stacks(), pins, switched };
  put([sessions, locals], KEY, JSON.stringify(all));
}
