import { fromHash, toHash } from "./address";
import { differing, limited, type State } from "./state";
import { put, sessions, taken } from "./storage";

/** What makes another page of the browser's history; all else changes the page that is shown. */
const TURNS: readonly (keyof State)[] = ["tab", "mode", "source", "sensor"];
const WRITTEN_MS = 150; // browsers limit how often an address may change
const KEPT = "omnimirror-address";

type Listener = (state: State, changed: Set<keyof State>) => void;

/** The one state of the page, and who wants to know of it. */
export class Store {
  state: State;
  /** What of the address is not understood, in a sentence. */
  trouble: string | null;
  /** Who is told when another address was entered. */
  entered: () => void = () => {};
  /** What is done before the page is left. */
  leaving: () => void = () => {};
  private readonly listeners: Listener[] = [];
  private pending = 0;
  private written = location.hash;

  constructor() {
    ({ state: this.state, trouble: this.trouble } = fromHash(beforeReload() ?? location.hash));
    for (const event of ["popstate", "hashchange"] as const)
      addEventListener(event, () => this.follow());
    addEventListener("pagehide", () => this.leave());
  }

  listen(listener: Listener): void {
    this.listeners.push(listener);
  }

  /** Change the state, and the address with it; `turns` is false for what nobody would go back from. */
  set(change: Partial<State>, turns = true): void {
    const next = limited({ ...this.state, ...change });
    const changed = differing(next, this.state);
    if (!changed.size) return;
    const isTurn = turns && TURNS.some((key) => changed.has(key));
    if (isTurn) this.write(); // where Back leads to is where it was left
    this.state = next;
    if (isTurn) this.write(true);
    this.tell(changed);
    clearTimeout(this.pending);
    this.pending = window.setTimeout(() => this.write(), WRITTEN_MS);
  }

  /** Go where the address leads: another link was entered, or Back or Forward pressed. */
  private follow(): void {
    if (location.hash === this.written) return;
    clearTimeout(this.pending);
    this.written = location.hash;
    const found = fromHash(location.hash);
    const next = { ...found.state, design: found.state.design || this.state.design };
    const changed = differing(next, this.state);
    this.state = next;
    this.trouble = found.trouble;
    this.entered();
    this.tell(changed);
  }

  private tell(changed: Set<keyof State>): void {
    for (const listener of this.listeners) listener(this.state, changed);
  }

  private write(isTurn = false): void {
    clearTimeout(this.pending);
    const text = toHash(this.state);
    const url = text || location.pathname + location.search;
    try {
      if (isTurn) history.pushState(null, "", url);
      else history.replaceState(null, "", url);
    } catch {
      return; // too often, for some browsers
    }
    this.written = location.hash;
  }

  /** A reload must find what was changed a moment ago. */
  private leave(): void {
    this.leaving();
    this.write();
    put([sessions], KEPT, toHash(this.state));
  }
}

/** What the page was left with, where it is loaded anew; null where an address was entered. */
function beforeReload(): string | null {
  const [way] = performance.getEntriesByType("navigation") as PerformanceNavigationTiming[];
  return way?.type === "reload" ? taken(sessions, KEPT) : null;
}
