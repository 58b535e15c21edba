import { fromHash, toHash } from "./address";
import { differing, limited, type State } from "./state";
import { put, sessions, load } from "./storage";

/** Keys whose change adds a history entry; others replace the current one. */
const HISTORY_KEYS: readonly (keyof State)[] = ["tab", "mode", "source", "sensor"];
const WRITTEN_MS = 150; // rate limit of browsers for address changes
const KEPT = "omnimirror-address";

type Listener = (state: State, changed: Set<keyof State>) => void;

/** State of the page, with listeners. */
export class Store {
  state: State;
  /** Message about invalid entries of the address. */
  error: string | null;
  /** Called when another address was entered. */
  entered: () => void = () => {};
  /** Called before the page is closed. */
  leaving: () => void = () => {};
  private readonly listeners: Listener[] = [];
  private pending = 0;
  private written = location.hash;

  constructor() {
    ({ state: this.state, error: this.error } = fromHash(beforeReload() ?? location.hash));
    for (const event of ["popstate", "hashchange"] as const)
      addEventListener(event, () => this.follow());
    addEventListener("pagehide", () => this.leave());
  }

  listen(listener: Listener): void {
    this.listeners.push(listener);
  }

  /** Change state and address; without a history entry if `turns` is false. */
  set(change: Partial<State>, addsHistory = true): void {
    const next = limited({ ...this.state, ...change });
    const changed = differing(next, this.state);
    if (!changed.size) return;
    const isTurn = addsHistory && HISTORY_KEYS.some((key) => changed.has(key));
    if (isTurn) this.write(); // store the last state of the current entry, to which Back returns
    this.state = next;
    if (isTurn) this.write(true);
    this.tell(changed);
    clearTimeout(this.pending);
    this.pending = window.setTimeout(() => this.write(), WRITTEN_MS);
  }

  /** Set the state of the address after a new link, Back or Forward. */
  private follow(): void {
    if (location.hash === this.written) return;
    clearTimeout(this.pending);
    this.written = location.hash;
    const result = fromHash(location.hash);
    const next = { ...result.state, design: result.state.design || this.state.design };
    const changed = differing(next, this.state);
    this.state = next;
    this.error = result.error;
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
      return; // rate limit of some browsers
    }
    this.written = location.hash;
  }

  /** Write pending changes, so that a reload restores them. */
  private leave(): void {
    this.leaving();
    this.write();
    put([sessions], KEPT, toHash(this.state));
  }
}

/** Return the state before a reload; null if an address was entered. */
function beforeReload(): string | null {
  const [way] = performance.getEntriesByType("navigation") as PerformanceNavigationTiming[];
  return way?.type === "reload" ? load(sessions, KEPT) : null;
}
