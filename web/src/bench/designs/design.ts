import type { Facts } from "../../shared/messages";

/** Parsed TOML; the server checks its entries. */
// eslint-disable-next-line @typescript-eslint/no-explicit-any
export type Tables = Record<string, any>;

/** Everything that says what design is on the bench. */
export interface Design {
  /** The sensor, as the tables of its file. */
  tables: Tables;
  /** Whether the lens stands where the mirror's mapping needs it. */
  follows: boolean;
  /** Distance of the objects, mm; null: infinite. */
  distance: number | null;
  /** Requirements, as the tables of their file. */
  requirements: Tables | null;
}

/** A design that is kept for comparison. */
export interface Pin {
  name: string;
  design: Design;
}

const MOST_UNDONE = 100;

/** The design in hand, and the ones before and after it. */
export class History {
  private past: Design[] = [];
  private future: Design[] = [];
  /** The last one that was settled on; sliders that are held go on from it. */
  private settled: Design;

  constructor(public now: Design) {
    this.settled = now;
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  get isHeld(): boolean {
    return this.now !== this.settled;
  }

  /** Settle on the design as it is now; tells whether it is another one. */
  settle(): boolean {
    const isNew = JSON.stringify(this.now) !== JSON.stringify(this.settled);
    if (isNew) {
      this.past = [...this.past, this.settled].slice(-MOST_UNDONE);
      this.future = [];
    }
    this.settled = this.now;
    return isNew;
  }

  /** Complete the design by what the server found; nothing to be undone. */
  complete(design: Design): void {
    const wasHeld = this.isHeld;
    this.now = design;
    if (!wasHeld) this.settled = design;
  }

  undo(): void {
    this.settle();
    const before = this.past.pop();
    if (before) this.go(before, this.future);
  }

  redo(): void {
    this.settle();
    const after = this.future.pop();
    if (after) this.go(after, this.past);
  }

  kept(): { past: Design[]; future: Design[] } {
    return { past: this.past, future: this.future };
  }

  restore(kept: { past: Design[]; future: Design[] }): void {
    this.past = kept.past;
    this.future = kept.future;
  }

  private go(to: Design, left: Design[]): void {
    left.push(this.settled);
    this.now = this.settled = to;
  }
}

/** The design with one entry of its tables changed; `index` is for one of a list. */
export function withEntry(
  design: Design,
  section: string,
  name: string,
  value: unknown,
  index?: number,
): Design {
  const table = { ...design.tables[section] };
  if (index === undefined) table[name] = value;
  else table[name] = (table[name] as number[]).map((old, i) => (i === index ? value : old));
  return { ...design, tables: { ...design.tables, [section]: table } };
}

/** The design with the distance that the server chose for a lens that follows the mirror. */
export function placed(design: Design, facts: Facts): Design {
  const distance = facts.mirror_distance_mm;
  const own = design.tables.mount?.mirror_distance_mm as number | undefined;
  if (!design.follows || distance === null || own === distance) return design;
  return withEntry(design, "mount", "mirror_distance_mm", distance);
}

export const nameOf = (design: Design): string =>
  (design.tables.name as string | undefined) ?? "design";
